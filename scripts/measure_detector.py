r"""Measure detectors of any weights in held-out towns, in the same towns mirrored, and on labelled real sweeps.

    python scripts/measure_detector.py pillars out/pillars2.safetensors --clips 12 --option realistic_share=1 \
        --real ~/real --frames kitti_000000,kitti_000001,kitti_000002,av2_7fab_0
    python scripts/measure_detector.py out/pillars2.safetensors --environments crossing,urban_grid

Prints a table in Markdown: AP of vehicles (BEV IoU 0.5) and people (0.3), the share of sure vehicles that face
backwards, and the median error of the velocities of what moves, as a share of its speed, where two sweeps were seen.
Towns are those of validation, 1000 to 1099, with `--option` as `WorldRecipe` has them; traffic of mirrored ones keeps
to the left. In them, objects are those that the agent's own LiDAR hits, and all counts within 50 m. `--environments`
are measured as `coopsim detect` does, and of them `own hits` alone counts what the agent hits. Differences from the
first weights are means over clips, with Student's 95 % interval.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from compare_places import difference
from measure_real_sweeps import PROTOCOL, WITHIN_M, linked, plan_of, with_weights
from tabulate import tabulate

from coopsim.bench.detect.detect import measure_detection, metrics_of
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.protocols import PROTOCOLS, VEHICLES, among
from coopsim.bench.detect.ranking import SURE, Overlaps, Ranking
from coopsim.bench.engine.engine import Engine
from coopsim.cli.argument_types import names
from coopsim.cli.arguments import add_options, named_options
from coopsim.errors import CoopsimError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.losses.street_losses import MOVING_M_S
from coopsim.learn.samples.sample_frames import boxes_in, joined, mirror, sweeps_of
from coopsim.learn.weights import load_detector
from coopsim.localization.odometry import Points
from coopsim.nn.inference.backend import find_backend
from coopsim.nn.inference.canvas import REACH_M
from coopsim.nn.inference.detectors import CloudDetector
from coopsim.recordings.formats import open_folder
from coopsim.types import Detections, GroundTruth

SHOWN = {"vehicles": "APBEV@0.5", "people": "APBEV@0.3 people", "own hits": "APBEV@0.5 own", "backwards": "backwards"}
PAIRED = ("vehicles", "people", "backwards")
LEAST_SCORE = 0.1
OWN, OF_OTHERS = 0, 1


@dataclass(frozen=True)
class Measured:
    """What a detector found in one clip: rankings by metric, and relative errors (N,) of velocities of what moves."""

    rankings: Mapping[str, Ranking]
    velocity_error: Floats

    def values(self) -> dict[str, float]:
        """Return the values by name; NaN where there was nothing."""
        return values_of([self])


def values_of(parts: Sequence[Measured]) -> dict[str, float]:
    """Return the values of clips together, by the names of `SHOWN`, and "velocity"."""
    found = metrics_of(PROTOCOLS.get(PROTOCOL)(), [each.rankings for each in parts])
    errors = np.concatenate([each.velocity_error for each in parts])
    return {
        **{name: as_number(found[metric]) for name, metric in SHOWN.items()},
        "velocity": float(np.median(errors)) if len(errors) else float("nan"),
    }


def as_number(value: float | None) -> float:
    """Return a metric, NaN for none."""
    return float("nan") if value is None else float(value)


def views_of(clip: Clip, sweeps: int, *, mirrored: bool) -> Iterator[tuple[Points, GroundTruth]]:
    """Yield the points (P, 5) and the truth of each agent in each scene that has a sweep before it."""
    for number, scene in enumerate(clip.scenes):
        if not joined(clip, number):
            continue
        for member, agent in enumerate(scene.agents):
            points = sweeps_of(clip, number, member, sweeps)
            boxes, velocity = boxes_in(scene.boxes, scene.velocity, agent.xyz_yaw)
            if mirrored:
                mirror(points, boxes, velocity)
            hit = scene.returns[:, member] > 0
            truth = GroundTruth(
                scene.object_id, Boxes3D.from_array(boxes), scene.label, np.where(hit, OWN, OF_OTHERS),
                velocity, scene.returns, counts=hit,
            )  # fmt: skip
            yield points, truth


def measure_clip(detector: CloudDetector, clip: Clip, *, mirrored: bool) -> Measured:
    """Return what a detector finds in a clip."""
    points, truth = zip(*views_of(clip, detector.sweeps, mirrored=mirrored), strict=True)
    found = detector.detect_around(points, REACH_M, LEAST_SCORE)
    perceived = Perceived.of(found, truth)
    near = Overlaps.of(perceived.within(WITHIN_M))
    return Measured(PROTOCOLS.get(PROTOCOL)().rankings(near), velocity_errors(Overlaps.of(perceived), found, truth))


def velocity_errors(
    overlaps: Overlaps, found: Sequence[Detections], truth: Sequence[GroundTruth], least_m_s: float = 2 * MOVING_M_S
) -> Floats:
    """Return the errors (N,) of velocities of sure vehicles that move, as shares of their speed; none if not stated."""
    there = overlaps.perceived
    true = np.concatenate([np.zeros((0, 2)), *(each.velocity for each in truth if each.velocity is not None)])
    stated = [np.full((len(each), 2), np.nan) if each.velocity is None else each.velocity for each in found]
    speed = np.linalg.norm(true, axis=1)
    moving = among(there.true_label, VEHICLES) & there.true_counts & (speed >= least_m_s)
    sure = among(there.found_label, VEHICLES) & (there.found_score > SURE)
    object_of = overlaps.matched_by_score(sure, moving, "BEV", 0.5, listed=False)
    hit = object_of >= 0
    away = np.concatenate([np.zeros((0, 2)), *stated])[hit] - true[object_of[hit]]
    error: Floats = np.linalg.norm(away, axis=1) / speed[object_of[hit]]
    return error[~np.isnan(error)]


def towns_of(weights: str, clips: Sequence[Clip]) -> dict[str, list[Measured]]:
    """Return what a detector finds in each clip, by place."""
    detector = CloudDetector(load_detector(weights), find_backend())
    return {
        place: [measure_clip(detector, clip, mirrored=mirrored) for clip in clips]
        for place, mirrored in (("towns", False), ("towns, mirrored", True))
    }


def beside(mine: Sequence[Measured], first: Sequence[Measured]) -> dict[str, str]:
    """Return the differences from the first weights as text, paired by clip."""
    shown = {}
    for name in PAIRED:
        pairs = [(one.values()[name], other.values()[name]) for one, other in zip(mine, first, strict=True)]
        shown[f"{name} - first"] = difference(np.array([one - other for one, other in pairs]))
    return shown


def measured_elsewhere(place: str, plan: DetectPlan) -> Iterator[dict[str, Any]]:
    """Yield a row for each environment of a plan."""
    for row in measure_detection(plan, engine=Engine(workers=1)):
        values = {name: as_number(row[metric]) for name, metric in SHOWN.items()}
        yield {"place": place or row["environment"], **values}


def rows_of(weights: Sequence[str], clips: Sequence[Clip], options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield all rows, those of one place together."""
    found = [towns_of(each, clips) for each in weights] if clips else []
    for place in found[0] if found else ():
        for name, each in zip(weights, found, strict=True):
            different = {} if each is found[0] else beside(each[place], found[0][place])
            yield {"weights": Path(name).stem, "place": place, **values_of(each[place]), **different}
    for name in weights:
        detector, about = with_weights(name), {"weights": Path(name).stem}
        if options.frames:
            folder = linked([options.real / f"{each}.npz" for each in options.frames], options.keep)
            plan = plan_of(folder, detector, len(open_folder(folder).sequences))
            yield from (about | row for row in measured_elsewhere("real sweeps", plan))
        if options.environments:
            plan = DetectPlan(("no_fusion",), options.environments, (0,), frames=8, every_s=0.4, detector=detector,
                              options={"dt_s": 0.2})  # fmt: skip
            yield from (about | row for row in measured_elsewhere("", plan))


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows as Markdown."""
    header = dict.fromkeys(name for row in rows for name in row)
    cells = [[_cell(row.get(name, "")) for name in header] for row in rows]
    return tabulate(cells, headers=list(header), tablefmt="github", disable_numparse=True)


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return "-" if np.isnan(value) else f"{value:.3f}"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", nargs="+", help="names of shipped weights of detectors, or paths of files")
    parser.add_argument("--clips", type=int, default=0, help="of held-out towns, two frames each (default: none)")
    parser.add_argument("--real", type=Path, help="folder with plain arrays, a frame a file")
    parser.add_argument("--frames", type=names, default=(), help="names of its files to measure, without .npz")
    parser.add_argument("--environments", type=names, default=(), help="to be measured as coopsim detect does")
    parser.add_argument("--keep", type=Path, default=Path("build/real_sweeps"), help="of links to frames")
    add_options(parser, "the towns' clips")
    options = parser.parse_args()
    if bool(options.real) != bool(options.frames):
        parser.error("--real and --frames go together: frames are named, so that none is looked at by chance")
    try:
        world = WorldRecipe.for_validation(**{"sweep_s": (0.1,), "frames": 2, **named_options(options)})
        clips = [SimulatedClips(world).clip(number) for number in range(options.clips)]
        print(table(list(rows_of(options.weights, clips, options))))
    except CoopsimError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
