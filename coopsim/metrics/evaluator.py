"""Scores an agent while it runs: counts per frame now, everything else from the log later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.metrics.candidate_pairs import Pairs, find_pairs
from coopsim.metrics.matching import KEEP_BONUS, match_frame
from coopsim.metrics.track_log import TrackLog
from coopsim.support.arrays import look_up
from coopsim.types import GroundTruth, Ints, Tracks
from coopsim.types.taxonomy import SUPERCLASS_NUMBERS

_SUPERCLASS = np.array(SUPERCLASS_NUMBERS)


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """One frame's counts; `idsw` are identity switches, `gt` boxes of objects."""

    tp: int
    fp: int
    fn: int
    idsw: int
    gt: int

    def as_dict(self) -> dict[str, int]:
        """By name."""
        return {"tp": self.tp, "fp": self.fp, "fn": self.fn, "idsw": self.idsw, "gt": self.gt}


class Evaluator:
    """One agent's running evaluation over one sequence, with CLEAR's matching (see `matching`).

    Args:
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
    """

    def __init__(self, match_iou: float = 0.25) -> None:
        self.log = TrackLog(match_iou)
        self._object = np.zeros(0, dtype=np.int64)  # ids seen so far, sorted
        self._last_track = np.zeros(0, dtype=np.int64)
        self._last_frame = np.zeros(0, dtype=np.int64)

    def update(self, truth: GroundTruth, tracks: Tracks) -> FrameCounts:
        """Score one frame.

        Args:
            truth: what is there.
            tracks: what is reported, in the same frame of reference.

        Raises:
            InvalidValueError: boxes are not finite or have no size, ids are not unique, or labels are no classes.
        """
        truth.validate()
        tracks.validate()
        if not len(tracks):
            self.log.append(truth, tracks, Pairs.none())
            return FrameCounts(0, 0, len(truth), 0, len(truth))
        frame = len(self.log)
        alike = find_pairs(truth.boxes, _SUPERCLASS[truth.label], tracks.boxes, _SUPERCLASS[tracks.label])
        self.log.append(truth, tracks, alike)
        pairs = alike[truth.label[alike.truth] == tracks.label[alike.track]]
        slots = self._slots(truth.id)
        kept = self._last_frame[slots] == frame - 1
        same = self._last_track[slots][pairs.truth] == tracks.id[pairs.track]
        weight = pairs.iou_3d + KEEP_BONUS * (kept[pairs.truth] & same)
        weight[pairs.iou_3d < self.log.match_iou] = 0.0
        chosen = match_frame(len(truth), len(tracks), pairs.truth, pairs.track, weight)
        hit = chosen >= 0
        track = tracks.id[pairs.track[chosen[hit]]]
        slots = slots[hit]
        switched = (self._last_frame[slots] >= 0) & (self._last_track[slots] != track)
        self._last_track[slots], self._last_frame[slots] = track, frame
        tp = int(hit.sum())
        return FrameCounts(tp, len(tracks) - tp, len(truth) - tp, int(switched.sum()), len(truth))

    def _slots(self, ids: Ints) -> Ints:
        """Where each of `ids` is kept, (N,); new ones get a place."""
        place, known = look_up(self._object, ids)
        if not known.all():
            new = np.sort(ids[~known])
            place = np.searchsorted(self._object, new)
            self._object = np.insert(self._object, place, new)
            self._last_track = np.insert(self._last_track, place, 0)
            self._last_frame = np.insert(self._last_frame, place, -2)
            place = np.searchsorted(self._object, ids)
        return place
