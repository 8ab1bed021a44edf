"""The log of a sequence for scoring: ids, classes, scores, distances and candidate pairs of every frame, no boxes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import (
    NEAR_M,
    CandidatePairs,
    NumberedSequence,
    SequenceArrays,
    SequenceMatches,
    frame_of,
)
from coopsim.support.checks import require_threshold
from coopsim.types import GroundTruth, Ints, Mask, Tracks

_TRUTH = {"truth_id": "q", "truth_label": "b", "truth_range_m": "f", "truth_seen_by": "b"}
_TRACK = {"track_id": "q", "track_label": "b", "track_range_m": "f", "score": "d"}
_PAIR = {"pair_truth": "i", "pair_track": "i", "iou_3d": "d", "iou_bev": "d", "distance_m": "d"}
_START = {"truth_start": "q", "track_start": "q", "pair_start": "q"}
_COLUMNS = {**_START, **_TRUTH, **_TRACK, **_PAIR}
"""The logged columns, with numpy's type codes."""

_WIDE = {"q": np.int64, "b": np.int64, "i": np.int64, "f": np.float64, "d": np.float64}
"""Type codes in the log, and the types of the same values in calculations."""

_BLOCK = 64
"""Number of frames that are packed at once."""


class TrackLog:
    """The log of one sequence of one agent, which grows frame by frame.

    Args:
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
    """

    def __init__(self, match_iou: float) -> None:
        require_threshold(match_iou=match_iou)
        self.match_iou = match_iou
        self._frames = 0
        self._ends = np.zeros(len(_START), dtype=np.int64)
        first = {name: [0] if name in _START else [] for name in _COLUMNS}
        self._blocks = [{name: np.array(first[name], code) for name, code in _COLUMNS.items()}]
        self._recent: list[tuple[Any, ...]] = []

    def __len__(self) -> int:
        return self._frames

    def append(self, truth: GroundTruth, true: Mask, tracks: Tracks, reported: Mask, pairs: CandidatePairs) -> None:
        """Add a frame, whose arrays must not change afterwards.

        `true` (N,) and `reported` (M,) mask the objects and tracks that count, `pairs` are those of one superclass
        among them.
        """
        seen_by = np.full(len(truth), -1) if truth.visible_to is None else truth.visible_to
        objects = [column[true] for column in (truth.id, truth.label, _range_m(truth.boxes), seen_by)]
        found = [column[reported] for column in (tracks.id, tracks.label, _range_m(tracks.boxes), tracks.score)]
        self._ends = self._ends + np.array([len(objects[0]), len(found[0]), len(pairs.truth)])
        self._recent.append((*self._ends[:, None], *objects, *found, *pairs))
        self._frames += 1
        if len(self._recent) == _BLOCK:
            self._join()

    def flat(self) -> FlatLog:
        """Return all frames as flat arrays, with the pairs of one superclass (see `FlatLog.by_class`)."""
        self._join()
        arrays: dict[str, Any] = {
            name: np.concatenate([block[name] for block in self._blocks], dtype=_WIDE[code])
            for name, code in _COLUMNS.items()
        }
        return FlatLog(**arrays, match_iou=self.match_iou)

    def _join(self) -> None:
        """Pack the last frames into one block, in types as small as their values allow."""
        if self._recent:
            columns = zip(_COLUMNS.items(), zip(*self._recent, strict=True), strict=True)
            self._blocks.append(
                {name: np.concatenate(parts, dtype=code, casting="unsafe") for (name, code), parts in columns}
            )
            self._recent = []


# Without slots, so that the numbering can be kept.
@dataclass(frozen=True, eq=False)
class FlatLog:
    """A sequence of F frames with G truth boxes, T reported boxes and P candidate pairs, as flat arrays.

    Attributes:
        truth_start: (F + 1,) offsets into the truth: where each frame begins.
        track_start: (F + 1,) offsets into the tracks.
        pair_start: (F + 1,) offsets into the pairs.
        truth_id: (G,).
        truth_label: (G,).
        truth_range_m: (G,) distance from the reporting agent, on the ground.
        truth_seen_by: (G,) index into `recall_by_visibility.SEEN_BY`, -1 where it is not known.
        track_id: (T,).
        track_label: (T,).
        track_range_m: (T,) distance from the reporting agent, on the ground.
        score: (T,) of the tracks.
        pair_truth: (P,) rows within the frame.
        pair_track: (P,) rows within the frame.
        iou_3d: (P,).
        iou_bev: (P,).
        distance_m: (P,) between the centres, on the ground.
        match_iou: 3D IoU from which a track is on an object.
    """

    truth_start: Ints
    track_start: Ints
    pair_start: Ints
    truth_id: Ints
    truth_label: Ints
    truth_range_m: Floats
    truth_seen_by: Ints
    track_id: Ints
    track_label: Ints
    track_range_m: Floats
    score: Floats
    pair_truth: Ints
    pair_track: Ints
    iou_3d: Floats
    iou_bev: Floats
    distance_m: Floats
    match_iou: float

    @property
    def labels(self) -> Ints:
        """The classes that occur in the truth, sorted."""
        return np.unique(self.truth_label)

    @cached_property
    def nearness(self) -> Floats:
        """(P,) 1 - distance / 2 m, at least 0: TrackEval's similarity by distance, with nuScenes' 2 m."""
        return np.maximum(0.0, 1.0 - self.distance_m / NEAR_M)

    @cached_property
    def matches(self) -> SequenceMatches:
        """CLEAR's matches of all tracks by 3D IoU, whatever their score."""
        return self.numbered(self.iou_3d, self.match_iou).match()

    def by_class(self) -> FlatLog:
        """Return the log without pairs of an object of one class and a track of another."""
        truth_row, track_row = self._pair_rows
        kept = self.truth_label[truth_row] == self.track_label[track_row]
        pairs = {name: getattr(self, name)[kept] for name in _PAIR}
        return replace(self, pair_start=_starts(_per_frame(kept, self.pair_start)), **pairs)

    def only(self, *labels: int) -> FlatLog:
        """Return the part of some classes, pooled."""
        return self._part(np.isin(self.truth_label, labels), np.isin(self.track_label, labels))

    def within(self, low_m: float, high_m: float) -> FlatLog:
        """Return the part from one distance to below another.

        An object belongs to the band in which it is. A track with a candidate object belongs to the band of the
        nearest one, so that no good pair is torn apart at a border; any other track belongs to its own.
        """
        belongs = self.track_range_m.copy()
        truth_row, track_row = self._pair_rows
        # The last written wins, so the nearest object comes last.
        order = np.argsort(-self.distance_m, kind="stable")
        belongs[track_row[order]] = self.truth_range_m[truth_row[order]]
        inside = [(low_m <= range_m) & (range_m < high_m) for range_m in (self.truth_range_m, belongs)]
        return self._part(*inside)

    def numbered(self, similarity: Floats, least: float = 0.0) -> NumberedSequence:
        """Prepare for a matching, with the pairs whose similarity (P,) is positive and at least `least`."""
        pair = (similarity > 0) & (similarity >= least)
        (objects, truth), (track, mean_score) = self._numbers
        arrays = SequenceArrays(
            self.truth_start,
            truth,
            self.track_start,
            track,
            _starts(_per_frame(pair, self.pair_start)),
            self.pair_truth[pair],
            self.pair_track[pair],
            similarity[pair],
        )
        return NumberedSequence(arrays, objects, mean_score)

    @cached_property
    def _numbers(self) -> tuple[tuple[int, Ints], tuple[Ints, Floats]]:
        """Number of objects, each truth box's object (G,); each reported box's track (T,), each track's mean score."""
        objects, truth = np.unique(self.truth_id, return_inverse=True)
        _, track, frames = np.unique(self.track_id, return_inverse=True, return_counts=True)
        return (len(objects), truth), (track, np.bincount(track, weights=self.score) / frames)

    @cached_property
    def _pair_rows(self) -> tuple[Ints, Ints]:
        """Rows (P,) of each pair's truth box and reported box in the sequence."""
        frame = frame_of(self.pair_start)
        return self.truth_start[frame] + self.pair_truth, self.track_start[frame] + self.pair_track

    def _part(self, truth: NDArray[np.bool_], track: NDArray[np.bool_]) -> FlatLog:
        """Return the part with the masked truth boxes (G,) and reported boxes (T,), and the pairs of both."""
        truth_row, track_row = self._pair_rows
        pair = truth[truth_row] & track[track_row]
        masks = {**dict.fromkeys(_TRUTH, truth), **dict.fromkeys(_TRACK, track), **dict.fromkeys(_PAIR, pair)}
        columns: dict[str, Any] = {name: getattr(self, name)[mask] for name, mask in masks.items()}
        columns["pair_truth"] = _rows_after(truth, self.truth_start)[truth_row][pair]
        columns["pair_track"] = _rows_after(track, self.track_start)[track_row][pair]
        starts = (("truth_start", truth), ("track_start", track), ("pair_start", pair))
        columns |= {name: _starts(_per_frame(mask, getattr(self, name))) for name, mask in starts}
        return FlatLog(**columns, match_iou=self.match_iou)


def _range_m(boxes: Boxes3D) -> Floats:
    """Return the distance (N,) from the origin, on the ground."""
    range_m: Floats = np.hypot(boxes.center[:, 0], boxes.center[:, 1])
    return range_m


def _starts(lengths: NDArray[np.integer[Any]] | NDArray[np.bool_]) -> Ints:
    """Return the offsets (N + 1,) of N consecutive parts of given lengths."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])


def _per_frame(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """Count the kept elements of each frame."""
    return np.diff(_starts(kept)[start])


def _rows_after(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """Return the row within its frame of each element once those that are not kept are gone."""
    total = _starts(kept)
    rows: Ints = total[:-1] - total[start[frame_of(start)]]
    return rows
