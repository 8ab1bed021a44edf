"""The demonstration: a few policies under a few latencies in the same traffic, and a report to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coopsim
from coopsim.bench.engine.result_of import result_of
from coopsim.bench.evaluate import Evaluation, evaluate
from coopsim.bench.films.film import Film, Rows
from coopsim.bench.films.filming import Filming
from coopsim.bench.films.space import CLOUD_POINTS
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.policies import arithmetic_of
from coopsim.bench.report.bench_report import About, write_bench_report
from coopsim.bench.report.scene import Scene, SceneRun
from coopsim.bench.report.space_data import SpaceRun, SpaceView
from coopsim.bench.results.result_table import ResultTable, named
from coopsim.catalog import PolicySpec
from coopsim.episode import Episode, Recorder
from coopsim.errors import EpisodeStateError
from coopsim.provided import listening_env
from coopsim.types import CameraImage

_POINTS_SHOWN = 2500


@dataclass(frozen=True, slots=True)
class DemoConfig:
    """Configuration of the demonstration.

    Attributes:
        policies: policies or their specs, see `PolicySpec`.
        latencies_s: latencies of each policy's runs; None: that of the options or of the scenario file.
        frames: length of each run.
        seed: seed of all runs, which so have the same traffic.
        options: further options of the environment.
    """

    environment: str = "crossing"
    policies: tuple[str, ...] = ("no_fusion", "late_fusion")
    latencies_s: tuple[float | None, ...] = (0.0, 0.3)
    frames: int = 100
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class DemoRun:
    """Finished run of the demonstration."""

    policy: str
    latency_s: float | None
    evaluation: Evaluation
    film: Film
    watch: _Watch

    @property
    def about(self) -> dict[str, str]:
        """The first columns of the run's row in a table."""
        latency = "the channel's" if self.latency_s is None else f"{self.latency_s * 1000:g} ms"
        return {"policy": named(self.policy, bound=self.evaluation.bound), "latency": latency}

    @property
    def tracks(self) -> list[Mapping[str, Rows]]:
        """The tracks of each frame, by reporting agent."""
        return [frame.tracks for frame in self.film.frames]

    @property
    def news(self) -> list[Mapping[str, Mapping[int, float]]]:
        """What messages have just told each agent of, in each frame."""
        film = self.film
        return [{name: film.news(name, k) for name in frame.told} for k, frame in enumerate(film.frames)]

    def result(self, config: DemoConfig) -> CellResult:
        """Return the run as a cell of a benchmark."""
        condition = Condition(str(config.environment), latency_s=self.latency_s or 0.0)
        used = arithmetic_of(PolicySpec.parse(self.policy), config.options.get("detector"))
        return result_of(Cell(self.policy, condition, config.seed, config.frames), self.evaluation, used)


class _Watch(Recorder):
    """Calls a function after every step, and keeps the images of all cameras after a number of steps; 0: none."""

    def __init__(self, tick: Callable[[], object], moment: int) -> None:
        self._tick, self._moment, self.time_ns = tick, moment, 0
        self.images: Mapping[str, Mapping[str, CameraImage]] = {}

    def on_step(self, episode: Episode) -> None:
        if episode.steps == self._moment:
            self.images, self.time_ns = episode.env.photograph(), episode.env.time_ns
        self._tick()


class Demo:
    """Runs the demonstration. Finished runs stay in `runs`, also when it is interrupted.

    Raises:
        CoopsimError: there is no such policy, environment or option, or a value is not accepted; before the first run.
    """

    def __init__(self, config: DemoConfig) -> None:
        self.config = config
        self.runs: list[DemoRun] = []
        for policy in [PolicySpec.parse(text).make() for text in config.policies]:
            for latency_s in config.latencies_s:
                listening_env(config.environment, policy, self._options(latency_s)).close()

    def run(self, tick: Callable[[], object]) -> None:
        """Run everything; `tick` is called after every frame."""
        for policy in self.config.policies:
            self._warm_up(policy)
            for latency_s in self.config.latencies_s:
                self.runs.append(self._run_one(policy, latency_s, tick))

    def write_report(self, path: Path, command: str = "") -> Path:
        """Write the finished runs as a benchmark's report with a scene; `command` is what reproduces it."""
        if not self.runs:
            raise EpisodeStateError("nothing has been run yet: call run first")
        config = self.config
        table = ResultTable.of([run.result(config) for run in self.runs])
        about = About(f"coopsim: {config.environment}", command, self._settings())
        return write_bench_report(path, table, about, scene=self._scene())

    def _options(self, latency_s: float | None) -> dict[str, Any]:
        latency = {} if latency_s is None else {"latency_s": latency_s}
        return {**self.config.options, **latency, "max_cycles": self.config.frames}

    def _warm_up(self, policy: str) -> None:
        """Compile functions that are compiled at their first call, to keep that out of the table's times."""
        options = self._options(self.config.latencies_s[0]) | {"max_cycles": min(2, self.config.frames)}
        evaluate(policy, self.config.environment, seed=self.config.seed, **options)

    def _run_one(self, policy: str, latency_s: float | None, tick: Callable[[], object]) -> DemoRun:
        """Run a policy. The first run films what all share: truth, points, and one moment through the cameras."""
        config, first = self.config, not self.runs
        filming = Filming(_POINTS_SHOWN if first else 0, space=CLOUD_POINTS if first else 0)
        watch = _Watch(tick, config.frames // 2 + 1 if first else 0)
        options = self._options(latency_s) | {"recorders": [filming, watch]}
        evaluation = evaluate(policy, config.environment, seed=config.seed, **options)
        return DemoRun(policy, latency_s, evaluation, filming.film, watch)

    def _scene(self) -> Scene:
        film, watch = self.runs[0].film, self.runs[0].watch
        runs = [
            SceneRun(f"{run.policy}, {run.about['latency']}", run.policy, run.evaluation.rewards, run.tracks, run.news)
            for run in self.runs
        ]
        cameras = {
            agent: {camera: image.rgb for camera, image in images.items() if image.rgb is not None}
            for agent, images in watch.images.items()
        }
        return Scene(film.dt_s, film.road_map, film.frames, runs, cameras, watch.time_ns, self._space())

    def _space(self) -> SpaceView:
        """Return the runs in three dimensions: the first one that heard of something is shown at first."""
        runs = [SpaceRun(f"{run.policy}, {run.about['latency']}", run.film) for run in self.runs]
        heard = [any(any(each.values()) for each in run.film.arrived) for run in self.runs]
        agent = next(iter(self.runs[0].film.frames[0].agents))
        return SpaceView(runs, agent, heard.index(True) if any(heard) else 0)

    def _settings(self) -> dict[str, str]:
        config, first = self.config, self.runs[0]
        return {
            "environment": str(config.environment),
            "seed": str(config.seed),
            "frames": f"{first.evaluation.frames} at {1 / first.film.dt_s:g} Hz",
            "false positives": "ignored" if first.evaluation.score.false_positives == "ignore" else "counted",
            **{
                name: f"{value:.4g}" if isinstance(value, float) else str(value)
                for name, value in config.options.items()
            },
            "coopsim": coopsim.__version__,
        }
