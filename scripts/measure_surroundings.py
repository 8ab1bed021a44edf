"""Measure how many labelled objects of real sweeps a detector misses for what surrounds them.

    python scripts/measure_surroundings.py REAL --sequences kitti,av2_7fab --frames 0 [--weights pillars]

REAL is a recording of any format that coopsim reads. Each object with enough returns is looked for three times: in the
whole sweep, in what is lower than 2.2 m in it, and in the points in and around its box alone. Prints a table in
Markdown. A vehicle is found by a box with a BEV IoU of at least 0.3, a person by one whose middle is within 0.5 m.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tabulate import tabulate

from coopsim.cli.argument_types import count, names, seeds
from coopsim.errors import CoopsimError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import center_distance_bev, iou_bev
from coopsim.geometry.se3 import Floats
from coopsim.learn.weights import load_detector
from coopsim.localization.odometry import Points, aged
from coopsim.nn.detector.decode import GROUP_OF_LABEL
from coopsim.nn.inference.canvas import REACH_M
from coopsim.nn.inference.detectors import CloudDetector
from coopsim.recordings.formats import open_folder
from coopsim.recordings.recorded_folder import RecordedFrame
from coopsim.recordings.recorded_scene import count_points_in
from coopsim.types import Detections, Ints, PointCloud
from coopsim.types.taxonomy import ObjectClass

VEHICLES, PEOPLE = (int(GROUP_OF_LABEL[each]) for each in (ObjectClass.CAR, ObjectClass.PEDESTRIAN))
KINDS = {"vehicles": VEHICLES, "people": PEOPLE}
FOUND = {VEHICLES: (iou_bev, 0.3), PEOPLE: (center_distance_bev, -0.5)}
"""By group: affinity of two boxes, and its least value for one to be that of the other."""

SHOWN = ("the whole sweep", "lower than 2.2 m", "the object alone")
LOW_M, AROUND_M, SCORE = 2.2, 1.0, 0.3


def seen(frame: RecordedFrame, least_returns: int, within_m: float) -> tuple[Points, Boxes3D, Ints]:
    """Return the first agent's points (P, 5), and boxes and groups (N,) of objects that it sees well, in its frame."""
    agent = next(iter(frame.agents.values()))
    sweep = agent.read_sweep()
    boxes = frame.objects.boxes.transform(agent.world_SE3_base.inverse())
    group = GROUP_OF_LABEL[frame.objects.label]
    kept = np.isin(group, list(FOUND)) & (np.hypot(*boxes.center[:, :2].T) <= within_m)
    kept &= count_points_in(boxes, [sweep.points]) >= least_returns
    return aged(PointCloud.of(sweep)), boxes[kept], group[kept]


def around(points: Points, box: Floats) -> Points:
    """Return the points in a box (7,) and beside it, none of what hangs over it."""
    cos, sin = np.cos(box[6]), np.sin(box[6])
    x, y = (points[:, axis] - box[axis] for axis in range(2))
    beside = np.maximum(np.abs(x * cos + y * sin) - box[3] / 2, np.abs(y * cos - x * sin) - box[4] / 2) <= AROUND_M
    kept: Points = points[beside & (points[:, 2] < max(LOW_M, box[2] + box[5] / 2))]
    return kept


def is_found(found: Detections, box: Floats, group: int) -> bool:
    """Return whether one of the boxes of a group is that of an object (7,)."""
    affinity, least = FOUND[group]
    boxes = found.boxes[GROUP_OF_LABEL[found.label] == group]
    return bool((affinity(box[None], boxes.array) >= least).any())


def looks(detector: CloudDetector, points: Points, boxes: Boxes3D, group: Ints) -> Iterator[tuple[int, list[bool]]]:
    """Yield the group of each object, and whether it is found in each of `SHOWN`."""
    clouds = [points, points[points[:, 2] < LOW_M], *(around(points, box) for box in boxes.array)]
    whole, low, *alone = detector.detect_around(clouds, REACH_M, SCORE)
    for box, each, own in zip(boxes.array, group.tolist(), alone, strict=True):
        yield each, [is_found(found, box, each) for found in (whole, low, own)]


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sequences", type=names, help="their names (default: all)")
    parser.add_argument("--frames", type=seeds, help="numbers of their frames, such as 0-3 (default: all)")
    parser.add_argument("--weights", default="pillars", help="name, or path of a file (default: %(default)s)")
    parser.add_argument("--least-returns", type=count, default=10, help="of an object (default: %(default)s)")
    parser.add_argument("--within-m", type=float, default=50.0, help="(default: %(default)s)")
    options = parser.parse_args()
    try:
        folder, net = open_folder(options.folder), load_detector(options.weights)
    except CoopsimError as error:
        parser.error(str(error))
    if unknown := sorted(set(options.sequences or ()) - set(folder.sequences)):
        parser.error(f"no sequence {', '.join(unknown)}, there are {', '.join(folder.sequences)}")
    detector = CloudDetector(net)
    found: dict[int, list[list[bool]]] = {group: [] for group in KINDS.values()}
    for name in options.sequences or folder.sequences:
        sequence = folder.open(name)
        for number in range(sequence.frames) if options.frames is None else options.frames:
            if number < sequence.frames:
                frame = sequence.frame(number)
                for group, each in looks(detector, *seen(frame, options.least_returns, options.within_m)):
                    found[group].append(each)
    rows = [
        [kind, len(found[group]), *np.reshape(found[group], (-1, len(SHOWN))).sum(axis=0)]
        for kind, group in KINDS.items()
    ]
    print(tabulate(rows, headers=["", "objects", *SHOWN], tablefmt="github"))


if __name__ == "__main__":
    main()
