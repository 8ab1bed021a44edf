"""Pictures of measured sweeps from above: points, labelled boxes, and the boxes that were found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.detect.detect_plan import DetectJob, DetectPlan
from coopsim.bench.detect.episode import pace_in, receiving
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.ranking import SURE
from coopsim.bench.grid.cell import environment_options
from coopsim.bench.store.store import Store
from coopsim.catalog import is_recordings_folder, parallel_env
from coopsim.errors import InvalidValueError
from coopsim.support.files import make_folder
from coopsim.types import NS_PER_S
from coopsim.viz.cloud_axes import draw_boxes, draw_cloud

REACH_M = 50.0
"""Half the width of the world that a picture shows, unless the plan has a largest distance."""

_INCHES, _DOTS_PER_INCH = 8.0, 120
_LABELLED, _FOUND, _UNCOUNTED = "tab:green", "tab:red", "tab:gray"


def require_recordings(plan: DetectPlan) -> None:
    """Raise `InvalidValueError` unless all environments of a plan are folders of recordings."""
    for environment in plan.environments:
        if not is_recordings_folder(environment):
            raise InvalidValueError(f"--pictures shows folders of recordings with sweeps, got {environment!r}")


def draw_measured(plan: DetectPlan, episodes: Path, out: Path) -> Iterator[Path]:
    """Draw every measured frame of a plan's finished episodes. Yield the paths of the pictures.

    Args:
        plan: plan in whose environments sweeps are read again.
        episodes: folder of the finished episodes, see `measure_detection`.
        out: folder of the pictures, made if need be.
    """
    make_folder(out)
    store = Store(episodes)
    for job in plan.jobs():
        result = store.get(job.key)
        if result is not None and not result.failed:
            yield from _draw_episode(job, Perceived.from_arrays(result.arrays), out, plan.within_m or REACH_M)


def _draw_episode(job: DetectJob, perceived: Perceived, out: Path, reach_m: float) -> Iterator[Path]:
    environment, seed = job.cell.condition.scenario, job.cell.seed
    whole = environment_options(replace(job.cell, frames=None), job.options)
    options = {name: value for name, value in whole.items() if name not in ("detector", "embedder")}
    with closing(parallel_env(environment, detector="none", expose_ground_truth=True, **options)) as env:
        pace, names, row = pace_in(environment, env, job.pace), receiving(env, job.selection), 0
        for number, frame in enumerate(env.frames(seed)):
            measured = not frame.last and pace.measures(number)
            for name in (each for each in names if measured and each in frame.agents):
                if row == perceived.receiver_frames:
                    return
                (sweep,) = frame.agents[name].observation.sweeps.values()
                sequence = env.sequences[seed % len(env.sequences)]
                title = f"{sequence}, {frame.time_ns / NS_PER_S:.1f} s, {name}, {job.policy.text}"
                path = out / f"{sequence.replace('/', '-')}-{number:04d}-{name}-{job.key[:6]}.png"
                yield draw_sweep(path, sweep.points, perceived, row, title, reach_m)
                row += 1


def draw_sweep(
    path: Path, points: NDArray[np.float32], perceived: Perceived, row: int, title: str, reach_m: float = REACH_M
) -> Path:
    """Draw a frame of a receiver from above, forward up. Return the path of the PNG file.

    Points become brighter with their height. A box has a line from its middle to its front. Of what was found, boxes
    with a score above `SURE` are shown.

    Args:
        path: PNG file; an older one is replaced.
        points: (N, 3) m in the receiver's base frame.
        perceived: episode of the frame.
        row: number of the receiver's frame in it.
        title: text above the picture.
        reach_m: half the width of the world that is shown.
    """
    from matplotlib.figure import Figure

    figure = Figure((_INCHES, _INCHES), dpi=_DOTS_PER_INCH, layout="constrained")
    axes = draw_cloud(figure.add_subplot(title=title), points, reach_m)
    true, found = (slice(*starts[row : row + 2]) for starts in (perceived.true_start, perceived.found_start))
    counts, sure = perceived.true_counts[true], perceived.found_score[found] > SURE
    for boxes, color, label in (
        (perceived.true_box[true][~counts], _UNCOUNTED, "labelled, does not count"),
        (perceived.true_box[true][counts], _LABELLED, "labelled"),
        (perceived.found_box[found][sure], _FOUND, f"found, score > {SURE:g}"),
    ):
        draw_boxes(axes, boxes, color, label)
    axes.legend(loc="upper right", framealpha=0.8)
    figure.savefig(path)
    return path
