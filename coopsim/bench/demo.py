"""The demonstration: a few policies under a few latencies in the same traffic, and a report to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import coopsim
from coopsim.bench.evaluate import Evaluation, evaluate, listening_env
from coopsim.bench.policy_spec import PolicySpec
from coopsim.bench.report.bev_data import thinned
from coopsim.bench.report.demo_report import ReportRun, ReportScene, write_report
from coopsim.bench.report.table import evaluation_row
from coopsim.errors import EpisodeStateError
from coopsim.types import CameraImage, Tracks
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import RoadMap

if TYPE_CHECKING:
    from coopsim.envs.parallel import CooperativeEnv

_POINTS_SHOWN = 2500


@dataclass(frozen=True, slots=True)
class DemoConfig:
    """What the demonstration runs.

    Attributes:
        environment: name of the environment.
        policies: as `PolicySpec` reads them.
        latencies_s: each policy runs under each; None: under what the options or the scenario file say.
        frames: length of each run.
        seed: the same for all runs, so that all see the same traffic.
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
    """One finished run of the demonstration."""

    policy: str
    latency_s: float | None
    evaluation: Evaluation
    tracks: Sequence[Mapping[str, Tracks]]

    @property
    def about(self) -> dict[str, str]:
        """What the run is, for the table."""
        latency = "the channel's" if self.latency_s is None else f"{self.latency_s * 1000:g} ms"
        return {"policy": self.policy, "latency": latency}


class Demo:
    """Runs the demonstration; what is finished stays in `runs`, also when it is interrupted.

    Raises:
        CoopsimError: there is no such policy, environment or option, or a value is not accepted. Told at once, since it
            should not cost the runs before it.
    """

    def __init__(self, config: DemoConfig) -> None:
        self.config = config
        self.runs: list[DemoRun] = []
        self._scene: ReportScene | None = None
        for policy in [PolicySpec.parse(text).make() for text in config.policies]:
            for latency_s in config.latencies_s:
                listening_env(config.environment, policy, self._options(latency_s)).close()

    def run(self, tick: Callable[[], object]) -> None:
        """Run everything; `tick` is called after every frame."""
        for policy in self.config.policies:
            self._warm_up(policy)
            for latency_s in self.config.latencies_s:
                self.runs.append(self._run_one(policy, latency_s, tick))

    def write_report(self, path: Path) -> Path:
        """Write what has been run as one HTML file."""
        if self._scene is None:
            raise EpisodeStateError("nothing has been run yet: call run first")
        runs = [
            ReportRun(
                label=f"{run.policy}, {run.about['latency']}",
                about=run.about,
                row=evaluation_row(run.evaluation),
                frame_score=run.evaluation.rewards,
                tracks=run.tracks,
            )
            for run in self.runs
        ]
        return write_report(path, self._scene, runs)

    def _options(self, latency_s: float | None) -> dict[str, Any]:
        latency = {} if latency_s is None else {"latency_s": latency_s}
        return {**self.config.options, **latency, "max_cycles": self.config.frames}

    def _warm_up(self, policy: str) -> None:
        """Have compiled what is compiled at its first call: on a new machine the table would show its time."""
        options = self._options(self.config.latencies_s[0]) | {"max_cycles": min(2, self.config.frames)}
        evaluate(policy, self.config.environment, seed=self.config.seed, **options)

    def _run_one(self, policy: str, latency_s: float | None, tick: Callable[[], object]) -> DemoRun:
        config = self.config
        tracks: list[Mapping[str, Tracks]] = []
        recorder = _SceneRecorder(config) if self._scene is None else None

        def on_frame(env: CooperativeEnv) -> None:
            shown = env.bev_frame(points=recorder is not None)
            tracks.append(shown.tracks)
            if recorder is not None:
                recorder.add(env, shown)
            tick()

        evaluation = evaluate(
            policy,
            config.environment,
            seed=config.seed,
            on_frame=on_frame,
            **self._options(latency_s),
        )
        if recorder is not None:
            self._scene = recorder.scene(evaluation)
        return DemoRun(policy, latency_s, evaluation, tracks)


class _SceneRecorder:
    """Collects from one run what all runs share: truth, points, and one moment through the cameras."""

    def __init__(self, config: DemoConfig) -> None:
        self._config = config
        self._frames: list[BevFrame] = []
        self._images: Mapping[str, Mapping[str, CameraImage]] = {}
        self._images_ns = 0
        self._dt_s = 0.0
        self._road_map: RoadMap

    def add(self, env: CooperativeEnv, shown: BevFrame) -> None:
        # The report shows thousands of points, not a hundred thousand.
        self._frames.append(replace(shown, points=thinned(shown.points, _POINTS_SHOWN), tracks={}))
        if len(self._frames) == self._config.frames // 2 + 1:
            self._images, self._images_ns = env.photograph(), env.time_ns
        self._dt_s = next(iter(env.agent_specs.values())).dt_s
        self._road_map = env.road_map

    def scene(self, evaluation: Evaluation) -> ReportScene:
        config = self._config
        counted = {"count": "counted", "ignore": "ignored"}[evaluation.score.false_positives]
        settings = {
            "environment": config.environment,
            "seed": str(config.seed),
            "frames": f"{len(self._frames)} at {1 / self._dt_s:g} Hz",
            "false positives": counted,
            **{
                name: f"{value:.4g}" if isinstance(value, float) else str(value)
                for name, value in config.options.items()
            },
            "coopsim": coopsim.__version__,
        }
        return ReportScene(
            title=f"coopsim: {config.environment}",
            dt_s=self._dt_s,
            road_map=self._road_map,
            frames=self._frames,
            cameras={
                agent: {camera: image.rgb for camera, image in cameras.items() if image.rgb is not None}
                for agent, cameras in self._images.items()
            },
            camera_time_ns=self._images_ns,
            settings=settings,
        )
