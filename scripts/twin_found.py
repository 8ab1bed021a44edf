"""What both cars of a recording set found of its labels: recall by range, false boxes, average precision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from detector_matches import AGENTS
from twin_worlds import TwinWorld

from coopsim.data.recording_set import RecordingSet
from coopsim.geometry.assignment import nearest_pairs
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import average_precision_of
from coopsim.types import Ints, Mask

EDGES_M = np.arange(0.0, 101.0, 10.0)
FOUND_M = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What both cars found of the labels of a recording set.

    Attributes:
        recording: (N,) number of each label's recording.
        range_m: (N,) from the first car.
        found: (N, 2) the first and the second car have a box.
        asked: (N, 2) neither car is asked for itself.
        false: recording and range (K, 2) of the false boxes of each car.
        precision: AP by BEV IoU 0.5 of each car.
    """

    recording: Ints
    range_m: Floats
    found: Mask
    asked: Mask
    false: tuple[Floats, Floats]
    precision: tuple[float, float]

    @classmethod
    def of(cls, folder: Path, twins: Mapping[str, TwinWorld]) -> Found:
        """Match the boxes of a recording set, whose labels have the rows of the twins'."""
        recordings, rows, false = RecordingSet(folder, "v2v4real"), [], ([], [])
        ranked: tuple[list[Any], list[Any]] = ([], [])
        for number, (name, world) in enumerate(twins.items()):
            recording, labels = recordings.load(name, AGENTS).first(world.recording.frames), world.labels
            asked = ~np.column_stack([labels.own, world.is_second(np.arange(len(labels.id)))])
            for k in range(recording.frames):
                truth, mine = recording.truth[k].boxes, asked[labels.frame == k]
                found = np.zeros((len(truth), 2), bool)
                for car, agent in enumerate(AGENTS):
                    boxes = recording.detections[agent][k]
                    away = np.linalg.norm(truth.center[:, None, :2] - boxes.boxes.center[:, :2], axis=2)
                    hits, ours = nearest_pairs(away, FOUND_M)
                    found[hits, car] = True
                    wrong = np.delete(boxes.boxes.center[:, :2], ours, axis=0)
                    false[car].append(np.column_stack([np.full(len(wrong), number), np.hypot(*wrong.T)]))
                    ranked[car].append(((boxes.boxes, boxes.score), truth[mine[:, car]]))
                range_m = np.hypot(*truth.center[:, :2].T)
                rows.append(np.column_stack([np.full(len(truth), number), range_m, found, mine]))
        table = np.concatenate(rows)
        precision = tuple(average_precision_of(*zip(*each, strict=True), view="BEV") for each in ranked)
        joined = tuple(np.concatenate(each) for each in false)
        return cls(table[:, 0].astype(np.int64), table[:, 1], table[:, 2:4] > 0, table[:, 4:] > 0, joined, precision)

    def recall(self, car: int) -> Floats:
        """Return a car's recall by bins of range."""
        rows = self.asked[:, car]
        return binned(self.range_m[rows], self.found[rows, car])

    def shares(self) -> Floats:
        """Return the shares of labels, but both cars', that both cars found, the first alone, the second, neither."""
        first, second = self.found[self.asked.all(axis=1)].T
        return np.array([each.mean() for each in (first & second, first & ~second, ~first & second, ~first & ~second)])


def binned(range_m: Floats, values: Mask) -> Floats:
    """Return means by bins of range; nan where there is nothing."""
    counts = np.histogram(range_m, EDGES_M)[0]
    sums = np.histogram(range_m, EDGES_M, weights=values.astype(float))[0]
    return np.divide(sums, counts, out=np.full(len(counts), np.nan), where=counts > 0)
