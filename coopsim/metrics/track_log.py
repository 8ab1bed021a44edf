"""What is kept of a sequence for scoring: who was there, how far away, and which pairs could be matches. No boxes."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.metrics.candidate_pairs import NEAR_M, Pairs
from coopsim.metrics.matching import NumberedSequence, SequenceArrays, frame_of
from coopsim.support.checks import require_threshold
from coopsim.types import GroundTruth, Ints, Tracks

_COLUMNS = {
    "truth_id": "q",
    "truth_label": "b",
    "truth_range": "f",
    "truth_seen_by": "b",
    "track_id": "q",
    "track_label": "b",
    "track_range": "f",
    "score": "d",
    "pair_truth": "i",
    "pair_track": "i",
    "iou_3d": "d",
    "iou_bev": "d",
    "distance": "d",
}
"""What is logged, and its type as `array` and numpy name it."""

_WIDE = {"q": np.int64, "b": np.int64, "i": np.int64, "f": np.float64, "d": np.float64}
"""The type that each has in calculations."""


class TrackLog:
    """One sequence of one agent, frame by frame.

    Columns grow as flat arrays: an hour of frames costs what is in them, not an object for each.

    Args:
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
    """

    def __init__(self, match_iou: float) -> None:
        require_threshold(match_iou=match_iou)
        self.match_iou = match_iou
        self._starts = {name: array("q", [0]) for name in ("truth_start", "track_start", "pair_start")}
        self._columns = {name: array(code) for name, code in _COLUMNS.items()}

    def __len__(self) -> int:
        return len(self._starts["truth_start"]) - 1

    def append(self, truth: GroundTruth, tracks: Tracks, pairs: Pairs) -> None:
        """Add a frame; the pairs are those of `find_pairs` by superclass."""
        for start, count in zip(self._starts.values(), (len(truth), len(tracks), len(pairs)), strict=True):
            start.append(start[-1] + count)
        seen_by = np.full(len(truth), -1) if truth.seen_by is None else truth.seen_by
        objects = (truth.id, truth.label, _range_m(truth.boxes), seen_by)
        reported = (tracks.id, tracks.label, _range_m(tracks.boxes), tracks.score)
        paired = (pairs.truth, pairs.track, pairs.iou_3d, pairs.iou_bev, pairs.distance)
        for column, values in zip(self._columns.values(), (*objects, *reported, *paired), strict=True):
            if len(values):
                column.frombytes(np.asarray(values, dtype=column.typecode).tobytes())

    def flat(self) -> FlatLog:
        """All frames as flat arrays, with the pairs of a superclass; `FlatLog.by_class` has those of a class."""
        columns = {**self._starts, **self._columns}
        arrays: dict[str, Any] = {name: np.array(column, _WIDE[column.typecode]) for name, column in columns.items()}
        return FlatLog(**arrays, match_iou=self.match_iou)


# Without slots, so that the numbering can be kept.
@dataclass(frozen=True, eq=False)
class FlatLog:
    """A sequence as flat arrays; offsets (F + 1,) say where each frame begins.

    Attributes:
        truth_start: offsets into the truth.
        track_start: offsets into the tracks.
        pair_start: offsets into the pairs.
        truth_id: (G,).
        truth_label: (G,).
        truth_range: (G,) m from the reporting agent, on the ground.
        truth_seen_by: (G,) who saw it, -1 where that is not known.
        track_id: (T,).
        track_label: (T,).
        track_range: (T,) m from the reporting agent, on the ground.
        score: (T,) of the tracks.
        pair_truth: (P,) rows within the frame.
        pair_track: (P,) rows within the frame.
        iou_3d: (P,).
        iou_bev: (P,).
        distance: (P,) m between the centres, on the ground.
        match_iou: 3D IoU from which a track is on an object.
    """

    truth_start: Ints
    track_start: Ints
    pair_start: Ints
    truth_id: Ints
    truth_label: Ints
    truth_range: Floats
    truth_seen_by: Ints
    track_id: Ints
    track_label: Ints
    track_range: Floats
    score: Floats
    pair_truth: Ints
    pair_track: Ints
    iou_3d: Floats
    iou_bev: Floats
    distance: Floats
    match_iou: float

    @property
    def labels(self) -> Ints:
        """The classes that occur in the truth, sorted."""
        return np.unique(self.truth_label)

    @cached_property
    def nearness(self) -> Floats:
        """(P,) 1 - distance / 2 m, at least 0: TrackEval's similarity by distance, with nuScenes' reach."""
        return np.maximum(0.0, 1.0 - self.distance / NEAR_M)

    def by_class(self) -> FlatLog:
        """The same with no pair of an object of one class and a track of another."""
        truth_row, track_row = self._pair_rows
        kept = self.truth_label[truth_row] == self.track_label[track_row]
        columns = ("pair_truth", "pair_track", "iou_3d", "iou_bev", "distance")
        pairs = {name: getattr(self, name)[kept] for name in columns}
        return replace(self, pair_start=_starts(_per_frame(kept, self.pair_start)), **pairs)

    def only(self, *labels: int) -> FlatLog:
        """The part of some classes, pooled."""
        return self._part(np.isin(self.truth_label, labels), np.isin(self.track_label, labels))

    def within(self, low_m: float, high_m: float) -> FlatLog:
        """The part from one distance to below another.

        An object belongs where it is. A track that is near an object belongs where that is, so that no good
        pair is torn apart at a border; any other belongs where it is itself.
        """
        belongs = self.track_range.copy()
        truth_row, track_row = self._pair_rows
        # The last written wins, so the nearest object comes last.
        order = np.argsort(-self.distance, kind="stable")
        belongs[track_row[order]] = self.truth_range[truth_row[order]]
        inside = [(low_m <= range_m) & (range_m < high_m) for range_m in (self.truth_range, belongs)]
        return self._part(*inside)

    def numbered(self, similarity: Floats, least: float = 0.0) -> NumberedSequence:
        """What a matching needs, with the pairs whose similarity (P,) is positive and at least `least`."""
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
        """How many objects, and which is each truth box's; which track is each reported box's, and mean scores."""
        objects, truth = np.unique(self.truth_id, return_inverse=True)
        _, track, frames = np.unique(self.track_id, return_inverse=True, return_counts=True)
        return (len(objects), truth), (track, np.bincount(track, weights=self.score) / frames)

    @cached_property
    def _pair_rows(self) -> tuple[Ints, Ints]:
        """(P,) where each pair's truth box and reported box stand."""
        frame = frame_of(self.pair_start)
        return self.truth_start[frame] + self.pair_truth, self.track_start[frame] + self.pair_track

    def _part(self, truth: NDArray[np.bool_], track: NDArray[np.bool_]) -> FlatLog:
        """The part with only some truth boxes (G,) and reported boxes (T,), and the pairs of both."""
        truth_row, track_row = self._pair_rows
        pair = truth[truth_row] & track[track_row]
        return FlatLog(
            truth_start=_starts(_per_frame(truth, self.truth_start)),
            track_start=_starts(_per_frame(track, self.track_start)),
            pair_start=_starts(_per_frame(pair, self.pair_start)),
            truth_id=self.truth_id[truth],
            truth_label=self.truth_label[truth],
            truth_range=self.truth_range[truth],
            truth_seen_by=self.truth_seen_by[truth],
            track_id=self.track_id[track],
            track_label=self.track_label[track],
            track_range=self.track_range[track],
            score=self.score[track],
            pair_truth=_rows_after(truth, self.truth_start)[truth_row][pair],
            pair_track=_rows_after(track, self.track_start)[track_row][pair],
            iou_3d=self.iou_3d[pair],
            iou_bev=self.iou_bev[pair],
            distance=self.distance[pair],
            match_iou=self.match_iou,
        )


def _range_m(boxes: Boxes3D) -> Floats:
    """(N,) m from the origin, on the ground."""
    range_m: Floats = np.hypot(boxes.center[:, 0], boxes.center[:, 1])
    return range_m


def _starts(lengths: NDArray[np.integer[Any]] | NDArray[np.bool_]) -> Ints:
    """Offsets (N + 1,) of N parts of these lengths."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])


def _per_frame(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """How many are kept in each frame."""
    return np.diff(_starts(kept)[start])


def _rows_after(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """The row within its frame that each kept element has once the others are gone."""
    total = _starts(kept)
    rows: Ints = total[:-1] - total[start[frame_of(start)]]
    return rows
