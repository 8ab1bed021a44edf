"""Place of a second car that senses, of which there are only boxes in the first car's frame.

A sensing car reports no box where it is itself, and none beyond its reach; the first car reports or labels it. On a
grid around the first car, turned as the first frame, each cell of a frame has the score

    max(exp(-d_first^2 / 2)) - 2 max(exp(-d_second^2 / 4.5)) - min(boxes of the second car beyond its reach, 3),

with distances in m to the first car's boxes and labels, and to the second car's boxes. The place is the path of most
score (Viterbi) that moves by a cell a frame at most; a label or else a box of the first car that is near replaces the
cell's. A score below `LEAST_SCORE` says that the first car saw nothing of it; then the middle of its own boxes stands
for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, uniform_filter1d

from coopsim.data.recorded_path import in_world
from coopsim.data.recording_set import Recording
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, GroundTruth, Ints, Mask

OWN_M = 2.5
"""Labels and boxes with a middle nearer than this to a sensing car are of the car itself."""

REACH_M = 80.5
"""Largest distance of a box of V2V4Real's detectors, whose field of view is 141 m long and 77 m wide."""

LEAST_SCORE = 0.55
"""Mean score below which the path is not the second car's: where labels show the car, it is 0.6 or more."""

_AXIS_M = np.arange(-110.0, 111.0, 2.0)
"""Middles of cells to both sides of the first car: a car goes by less than 2 m a frame relative to it."""

_AROUND = 10
_FEWEST = 5
"""Frames in which an object has to be near the path, to be the second car."""


@dataclass(frozen=True, slots=True, eq=False)
class SecondCar:
    """The second car in the first one's frame, in F frames.

    Attributes:
        place: (F, 2) m.
        heading: (F,) rad.
        label: (F,) id of the label that says it; -1: none does.
        boxed: (F,) flags: there is no label, but a box of the first car.
        score: mean score of the path, at most about 1.
    """

    place: Floats
    heading: Floats
    label: Ints
    boxed: Mask
    score: float


def find_second_car(recording: Recording, names: Sequence[str], pose: Floats) -> SecondCar:
    """Return where the second car is.

    Args:
        recording: a recording with detections of both cars.
        names: their names, the first car's first.
        pose: (F, 3) the first car's path.
    """
    frames = [
        _Frame.of(recording.truth[k], recording.detections[names[0]][k], recording.detections[names[1]][k], pose[k, 2])
        for k in range(recording.frames)
    ]
    cells, score = _best_path([each.scores() for each in frames])
    label = np.full(len(frames), -1)
    if score < LEAST_SCORE:
        return SecondCar(_middle_of_boxes(recording, names[1]), np.zeros(len(frames)), label, label >= 0, score)
    place, boxed = _AXIS_M[cells], np.zeros(len(frames), bool)
    for k, frame in enumerate(frames):
        place[k], label[k], boxed[k] = frame.nearest(place[k])
    rare = np.isin(label, [each for each in np.unique(label) if (label == each).sum() < _FEWEST])
    label[rare] = -1
    turned = _turned_back(place, pose[:, 2])
    return SecondCar(turned, _headings(recording.truth, label, pose), label, boxed, score)


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """Places (N, 2) of one frame around the first car, in the first frame's directions."""

    labels: Floats
    ids: Ints
    first: Floats
    second: Floats

    @classmethod
    def of(cls, truth: GroundTruth, first: Detections, second: Detections, heading: float) -> _Frame:
        other = np.hypot(*truth.boxes.center[:, :2].T) > OWN_M
        seen = first.boxes.center[:, :2]
        seen = seen[np.hypot(*seen.T) > OWN_M]
        places = (truth.boxes.center[other, :2], seen, second.boxes.center[:, :2])
        labels, seen, second_m = (_turned_back(each, np.full(len(each), -heading)) for each in places)
        return cls(labels, truth.id[other], seen, second_m)

    def scores(self) -> Floats:
        """Return the scores (C, C) of cells."""
        mine, theirs = _squared(np.concatenate([self.labels, self.first])), _squared(self.second)
        found = np.exp(-mine.min(axis=2, initial=np.inf) / 2) - 2 * np.exp(-theirs.min(axis=2, initial=np.inf) / 4.5)
        scores: Floats = found - np.minimum((theirs > REACH_M**2).sum(axis=2), 3)
        scores[_squared(np.zeros((1, 2)))[..., 0] < (2 * OWN_M) ** 2] -= 1.0  # that is the first car
        return scores

    def nearest(self, place: Floats) -> tuple[Floats, int, bool]:
        """Return the label's place near a place, else the box's, else itself; the label's id or -1; whether a box."""
        for places, is_box in ((self.labels, False), (self.first, True)):
            away = np.hypot(*(places - place).T)
            if len(away) and away.min() < OWN_M:
                row = int(away.argmin())
                return places[row], -1 if is_box else int(self.ids[row]), is_box
        return place, -1, False


def _best_path(scores: list[Floats]) -> tuple[Ints, float]:
    """Return the cells (F, 2) of most score, and the mean score."""
    best = scores[:1]
    for each in scores[1:]:
        best.append(each + maximum_filter(best[-1], 3, mode="constant", cval=-np.inf))
    mean, cells = float(best[-1].max()) / len(scores), [_highest(best[-1])]
    for each in best[-2::-1]:
        low = np.maximum(cells[-1] - 1, 0)
        cells.append(low + _highest(each[low[0] : cells[-1][0] + 2, low[1] : cells[-1][1] + 2]))
    return np.array(cells[::-1]), mean


def _highest(scores: Floats) -> Ints:
    return np.array(np.unravel_index(int(scores.argmax()), scores.shape))


def _middle_of_boxes(recording: Recording, name: str) -> Floats:
    """Return the median place (F, 2) of a car's boxes in the two seconds around each frame, in turn averaged so."""
    boxes = [each.boxes.center[:, :2] for each in recording.detections[name]]
    around = [np.concatenate(boxes[max(k - _AROUND, 0) : k + _AROUND + 1]) for k in range(len(boxes))]
    medians = np.array([np.median(each, axis=0) if len(each) else np.zeros(2) for each in around])
    averaged: Floats = uniform_filter1d(medians, 2 * _AROUND + 1, axis=0, mode="nearest")
    return averaged


def _headings(truth: Sequence[GroundTruth], label: Ints, pose: Floats) -> Floats:
    """Return headings (F,): of labels, in between interpolated in the world; without any label the first car's."""
    rows = np.flatnonzero(label >= 0)
    if not len(rows):
        return np.zeros(len(label))
    labelled = [float(truth[k].boxes.yaw[truth[k].id == label[k]][0]) for k in rows.tolist()]
    known = np.unwrap(np.array(labelled) + pose[rows, 2])
    headings: Floats = np.interp(np.arange(len(label)), rows, known) - pose[:, 2]
    return headings


def _turned_back(place: Floats, heading: Floats) -> Floats:
    return in_world(place, np.column_stack([np.zeros((len(place), 2)), -heading]))


def _squared(place: Floats) -> Floats:
    """Return the squared distances (C, C, N) of cells to places (N, 2)."""
    along, across = ((_AXIS_M[:, None] - column) ** 2 for column in place.T)
    squared: Floats = along[:, None] + across[None]
    return squared
