"""Scoring of an agent while it runs: per-frame counts at once, everything else later from the log."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from coopsim.metrics.candidate_pairs import CandidatePairs, find_candidate_pairs
from coopsim.metrics.matching import KEEP_BONUS, match_frame
from coopsim.metrics.track_log import TrackLog
from coopsim.support.arrays import look_up
from coopsim.types import GroundTruth, Ints, Mask, Tracks
from coopsim.types.taxonomy import SUPERCLASS_NUMBERS

_SUPERCLASS = np.array(SUPERCLASS_NUMBERS)


@dataclass(frozen=True, slots=True)
class FrameCounts:
    """Counts of one frame.

    Attributes:
        tp: matched boxes.
        fp: reported boxes without an object.
        fn: objects without a track.
        idsw: identity switches.
        gt: objects.
    """

    tp: int
    fp: int
    fn: int
    idsw: int
    gt: int

    def as_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


class Evaluator:
    """The running evaluation of one agent over one sequence, with CLEAR's matching (see `matching`).

    Args:
        match_iou: 3D IoU from which a track is on an object, in (0, 1].

    Attributes:
        log: everything that scores need, of all frames so far.
    """

    def __init__(self, match_iou: float = 0.25) -> None:
        self.log = TrackLog(match_iou)
        self._object = np.zeros(0, dtype=np.int64)  # ids so far, sorted
        self._last_track = np.zeros(0, dtype=np.int64)
        self._last_frame = np.zeros(0, dtype=np.int64)

    def update(self, truth: GroundTruth, tracks: Tracks) -> FrameCounts:
        """Score one frame.

        Objects that do not count (`GroundTruth.counts`) are left out, and so are the tracks that are on them rather
        than on one that counts: a tracker that carries on an object which no agent sees any more is neither rewarded
        nor punished for it.

        Args:
            truth: the objects.
            tracks: the reported tracks, in the same frame of reference.

        Raises:
            InvalidValueError: boxes are not finite or have no size, ids are not unique, or labels are no classes.
        """
        truth.validate()
        tracks.validate()
        candidates = CandidatePairs.empty()
        if len(tracks):
            kinds = _SUPERCLASS[truth.label], _SUPERCLASS[tracks.label]
            candidates = find_candidate_pairs(truth.boxes, kinds[0], tracks.boxes, kinds[1])
        if truth.counts is not None and not truth.counts.all():
            tracks, candidates = self._without_ignored(truth, truth.counts, tracks, candidates)
            truth = truth.counted
        if not len(tracks):
            self.log.append(truth, tracks, candidates)
            return FrameCounts(0, 0, len(truth), 0, len(truth))
        frame = len(self.log)
        self.log.append(truth, tracks, candidates)
        pairs = candidates[truth.label[candidates.truth] == tracks.label[candidates.track]]
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

    def _without_ignored(
        self, truth: GroundTruth, counts: Mask, tracks: Tracks, candidates: CandidatePairs
    ) -> tuple[Tracks, CandidatePairs]:
        """Leave out tracks on objects that do not count, and pairs of these; rows of the rest are numbered anew."""
        pairs = candidates[truth.label[candidates.truth] == tracks.label[candidates.track]]
        best = np.zeros((2, len(tracks)))  # 3D IoU with objects that do not count, and with those that do
        np.maximum.at(best, (counts[pairs.truth].astype(np.int64), pairs.track), pairs.iou_3d)
        kept = (best[0] < self.log.match_iou) | (best[1] >= best[0])
        rest = candidates[counts[candidates.truth] & kept[candidates.track]]
        rows, columns = np.cumsum(counts) - 1, np.cumsum(kept) - 1
        return tracks[kept], replace(rest, truth=rows[rest.truth], track=columns[rest.track])

    def _slots(self, ids: Ints) -> Ints:
        """Return the slot (N,) in which each object's last match is kept; new objects get one."""
        place, known = look_up(self._object, ids)
        if not known.all():
            new = np.sort(ids[~known])
            place = np.searchsorted(self._object, new)
            self._object = np.insert(self._object, place, new)
            self._last_track = np.insert(self._last_track, place, 0)
            self._last_frame = np.insert(self._last_frame, place, -2)
            place = np.searchsorted(self._object, ids)
        return place
