"""Measure how often PointRCNN confuses classes on KITTI, for `coopsim.detection.simulated.curves`.

    python scripts/measure_confusion.py DATA [--score 0]

DATA has kitti with labels/ and detections/. Each labelled object takes the class of its surest detection within 2 m
(1 m for people and cyclists) of which it is the nearest object. Detections are of cars, pedestrians and cyclists only.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from coopsim.data.recording_set import RecordingSet
from coopsim.types import Detections, GroundTruth, Ints
from coopsim.types.taxonomy import CLASS_NAMES, ObjectClass

DETECTIONS = ("pointrcnn_Car", "pointrcnn_Cyclist", "pointrcnn_Pedestrian")
SMALL = (ObjectClass.PEDESTRIAN, ObjectClass.BICYCLE)


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description="Measure confused classes on KITTI.")
    parser.add_argument("data", type=Path, help="folder with kitti")
    parser.add_argument("--score", type=float, default=0.0, help="ignore detections below this score")
    args = parser.parse_args()
    recordings = RecordingSet(args.data / "kitti")
    counts: Counter[tuple[str, str]] = Counter()
    again: Counter[bool] = Counter()
    for sequence in recordings.sequences:
        recording = recordings.load(sequence, DETECTIONS)
        before: dict[int, bool] = {}
        for frame, truth in enumerate(recording.truth):
            found = Detections.concatenate(each[frame] for each in recording.detections.values())
            reported = reported_classes(truth, found[found.score >= args.score])
            now = {}
            for identity, label, other in zip(truth.id.tolist(), truth.label, reported, strict=True):
                if other < 0:
                    continue
                counts[CLASS_NAMES[label], CLASS_NAMES[other]] += 1
                if label in SMALL:
                    now[identity] = bool(label != other)
                    if before.get(identity):
                        again[now[identity]] += 1
            before = now
    for (true, reported_as), count in sorted(counts.items()):
        row = sum(each for (name, _), each in counts.items() if name == true)
        print(f"{true:>10} reported as {reported_as:<10} {count:6} of {row}: {count / row:.3f}")
    print(f"a person's or cyclist's wrong label is wrong again in the next frame: {again[True] / again.total():.2f}")


def reported_classes(truth: GroundTruth, found: Detections) -> Ints:
    """Return the class that each object is reported as, (N,), -1 for objects that are not found."""
    reported = np.full(len(truth), -1)
    if not (len(truth) and len(found)):
        return reported
    gap_m = np.linalg.norm(truth.boxes.center[:, None, :2] - found.boxes.center[None, :, :2], axis=2)
    near = gap_m < np.where(np.isin(truth.label, SMALL), 1.0, 2.0)[:, None]
    near &= gap_m.argmin(axis=0) == np.arange(len(truth))[:, None]
    surest = np.where(near, found.score, -np.inf).argmax(axis=1)
    some = near.any(axis=1)
    reported[some] = found.label[surest[some]]
    return reported


if __name__ == "__main__":
    main()
