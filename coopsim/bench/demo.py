"""The demonstration: a few policies under a few latencies in the same traffic, and a report to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.bench.report import ReportRun, ReportScene, write_report
from coopsim.bench.runner import Evaluation, evaluate
from coopsim.bench.table import evaluation_row
from coopsim.catalog import make_policy
from coopsim.types import CameraImage, Tracks
from coopsim.viz.bev import BevFrame

if TYPE_CHECKING:
    from coopsim.envs.parallel import CooperativeEnv

_POINTS_SHOWN = 2500


@dataclass(frozen=True, slots=True)
class DemoConfig:
    """What the demonstration runs.

    Attributes:
        environment: name of the environment.
        policies: names of the policies.
        latencies_s: each policy runs under each.
        frames: length of each run.
        seed: the same for all runs, so that all see the same traffic.
        options: further options of the environment.
    """

    environment: str = "crossing"
    policies: tuple[str, ...] = ("no_fusion", "late_fusion")
    latencies_s: tuple[float, ...] = (0.0, 0.3)
    frames: int = 100
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class DemoRun:
    """One finished run of the demonstration."""

    policy: str
    latency_s: float
    evaluation: Evaluation
    tracks: Sequence[Mapping[str, Tracks]]

    @property
    def about(self) -> dict[str, str]:
        """What the run is, for the table."""
        return {"policy": self.policy, "latency": f"{self.latency_s * 1000:.0f} ms"}


class Demo:
    """Runs the demonstration; what is finished stays in `runs`, also when it is interrupted."""

    def __init__(self, config: DemoConfig) -> None:
        self.config = config
        self.runs: list[DemoRun] = []
        self._scene = _SceneRecorder(middle=config.frames // 2)
        for name in config.policies:
            make_policy(name)  # a typo in the last policy should not cost the runs before it

    def run(self, tick: Callable[[], object]) -> None:
        """Run everything; `tick` is called after every frame."""
        config = self.config
        for policy in config.policies:
            for latency_s in config.latencies_s:
                tracks: list[Mapping[str, Tracks]] = []
                watch_scene = self._scene if not self.runs else None

                def on_frame(env: CooperativeEnv) -> None:
                    shown = env.bev_frame()
                    tracks.append(shown.tracks)  # noqa: B023  (called before the next turn of the loop)
                    if watch_scene is not None:  # noqa: B023
                        watch_scene.add(env, shown)  # noqa: B023
                    tick()

                evaluation = evaluate(
                    policy,
                    config.environment,
                    seed=config.seed,
                    on_frame=on_frame,
                    latency_s=latency_s,
                    max_cycles=config.frames,
                    **config.options,
                )
                self.runs.append(DemoRun(policy, latency_s, evaluation, tracks))

    def write_report(self, path: Path) -> Path:
        """Write what has been run as one HTML file."""
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
        return write_report(path, self._scene.finish(self.config), runs)


class _SceneRecorder:
    """Collects what all runs share: truth, points, and one moment through the cameras."""

    def __init__(self, middle: int) -> None:
        self._middle = middle
        self._frames: list[BevFrame] = []
        self._images: Mapping[str, Mapping[str, CameraImage]] = {}
        self._images_ns = 0
        self._env: CooperativeEnv | None = None

    def add(self, env: CooperativeEnv, shown: BevFrame) -> None:
        # The report shows thousands of points, not a hundred thousand: every n-th of the sweeps' order, which
        # runs around the sensor, thins them evenly.
        stride = max(1, -(-len(shown.points) // _POINTS_SHOWN))
        self._frames.append(replace(shown, points=shown.points[::stride], tracks={}))
        if len(self._frames) == self._middle + 1:
            self._images, self._images_ns = env.photograph(), env.time_ns
        self._env = env

    def finish(self, config: DemoConfig) -> ReportScene:
        assert self._env is not None, "nothing has been run"
        images = {
            agent: {camera: image.rgb for camera, image in cameras.items()} for agent, cameras in self._images.items()
        }
        spec = next(iter(self._env.agent_specs.values()))
        settings = {
            "environment": config.environment,
            "seed": str(config.seed),
            "frames": f"{config.frames} at {1 / spec.dt_s:g} Hz",
            "false positives": "counted",
            **{name: f"{value:.4g}" for name, value in config.options.items()},
        }
        return ReportScene(
            title=f"coopsim: {config.environment}",
            dt_s=spec.dt_s,
            road_map=self._env.road_map,
            frames=self._frames,
            cameras=images,
            camera_time_ns=self._images_ns,
            settings=settings,
        )
