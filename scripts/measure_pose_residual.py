"""Measure how far two cars' boxes of the same objects lie apart in V2V4Real: what its poses leave wrong.

    python scripts/measure_pose_residual.py path/to/v2v4real/train

In each frame the objects that both cars detect are shifted and turned against each other as a whole: by the error of
the relative pose, and by part of each box's own error. The latter is taken off. Half of the variance is each car's.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from coopsim.data.recording_set import Recording, RecordingSet
from coopsim.geometry.assignment import nearest_pairs
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections

WITHIN_M = 2.5
"""Largest distance of a box from the object that it is of: about half the length of a car."""
LEAST_SCORE, LEAST_OBJECTS = 0.3, 3
MAD_PER_SD = 0.6745
"""Median absolute deviation of a normal number, in standard deviations: a few frames have boxes of other objects."""


def main() -> None:
    """Read the arguments and print both residuals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, help="folder of the recordings")
    recordings = RecordingSet(parser.parse_args().recordings)
    pairs = common_objects(recordings.load(each, ("ego", "1")) for each in recordings.sequences)
    shift, turn = residuals(pairs)
    print(f"{len(pairs)} frames in which both cars detect {LEAST_OBJECTS} objects or more")
    print(f"relative: {shift:.2f} m an axis, {turn:.2f} degrees")
    print(f"of each car: {shift / 2**0.5:.2f} m, {turn / 2**0.5:.2f} degrees")


def common_objects(recordings: Iterable[Recording]) -> list[tuple[Floats, Floats]]:
    """Return both cars' centres (N, 2) m of the same N objects, for each frame."""
    found = []
    for recording in recordings:
        for frame in range(recording.frames):
            truth = recording.truth[frame].boxes.center[:, :2]
            first, second = (centres_by_object(recording.detections[car][frame], truth) for car in ("ego", "1"))
            both = sorted(first.keys() & second.keys())
            if len(both) >= LEAST_OBJECTS:
                found.append((np.array([first[k] for k in both]), np.array([second[k] for k in both])))
    return found


def centres_by_object(detections: Detections, truth: Floats) -> dict[int, Floats]:
    """Return the centre (2,) of the box of each object that has one."""
    centres = detections.boxes.center[detections.score > LEAST_SCORE, :2]
    apart = np.linalg.norm(centres[:, None] - truth, axis=2)
    return {int(k): centres[i] for i, k in zip(*nearest_pairs(apart, WITHIN_M), strict=True)}


def residuals(pairs: list[tuple[Floats, Floats]]) -> tuple[float, float]:
    """Return standard deviations of shifts, m an axis, and turns, degrees, without what boxes' own errors add."""
    shifts = np.array([(second - first).mean(axis=0) for first, second in pairs])
    own = np.concatenate([second - first - (second - first).mean(axis=0) for first, second in pairs])
    box = spread(own) ** 2 * np.mean([len(first) / (len(first) - 1) for first, _ in pairs])
    of_shift = spread(shifts) ** 2 - box * np.mean([1 / len(first) for first, _ in pairs])
    turns, by_boxes = [], []
    for first, second in pairs:
        here, there = first - first.mean(axis=0), second - second.mean(axis=0)
        turns.append(np.arctan2((here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]).sum(), (here * there).sum()))
        by_boxes.append(box.mean() / (here**2).sum())
    of_turn = spread(np.array(turns)[:, None])[0] ** 2 - np.median(by_boxes)
    return float(np.sqrt(np.mean(np.maximum(of_shift, 0)))), float(np.degrees(np.sqrt(max(of_turn, 0))))


def spread(values: Floats) -> Floats:
    """Return robust standard deviations of columns around their medians."""
    robust: Floats = np.median(np.abs(values - np.median(values, axis=0)), axis=0) / MAD_PER_SD
    return robust


if __name__ == "__main__":
    main()
