"""What is kept of a sequence for scoring: who was where, and which pairs could be matches. No boxes."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.checks import require_threshold
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import SequenceArrays
from coopsim.types import Ints, Tracks


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """The objects that count in one frame.

    Attributes:
        id: (N,) int, unique within the frame and constant over an object's life.
        boxes: N boxes, in the frame in which tracks are reported.
        label: (N,) int, an `ObjectClass`.
    """

    id: Ints
    boxes: Boxes3D
    label: Ints

    @classmethod
    def empty(cls) -> GroundTruth:
        """No objects."""
        none = np.zeros(0, dtype=np.int64)
        return cls(none, Boxes3D.empty(), none)

    def __len__(self) -> int:
        return len(self.boxes)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Pairs of one frame that may be matched: same class, and similar enough.

    Attributes:
        truth: (P,) rows of the truth.
        track: (P,) rows of the tracks.
        similarity: (P,) 3D IoU.
    """

    truth: Ints
    track: Ints
    similarity: Floats


def candidates(truth: GroundTruth, tracks: Tracks, match_iou: float) -> Candidates:
    """The pairs of a frame whose 3D IoU is at least `match_iou`."""
    similarity = iou_3d(truth.boxes.array, tracks.boxes.array)
    similarity[truth.label[:, None] != tracks.label] = 0.0
    # Contiguous, so that the compiled matching is compiled for one layout.
    rows, columns = map(np.ascontiguousarray, np.nonzero(similarity >= match_iou))
    return Candidates(rows, columns, similarity[rows, columns])


_COLUMNS = {
    "truth_id": "q",
    "truth_label": "b",
    "track_id": "q",
    "track_label": "b",
    "score": "d",
    "pair_truth": "i",
    "pair_track": "i",
    "similarity": "d",
}
"""What is logged, and its type as `array` and numpy name it."""


class TrackLog:
    """One sequence of one agent, frame by frame.

    Columns grow as flat arrays: an hour of frames costs what is in them, not an object for each.

    Args:
        match_iou: the threshold of the candidates.
    """

    def __init__(self, match_iou: float) -> None:
        require_threshold(match_iou=match_iou)
        self.match_iou = match_iou
        self._starts = {name: array("q", [0]) for name in ("truth_start", "track_start", "pair_start")}
        self._columns = {name: array(code) for name, code in _COLUMNS.items()}

    def __len__(self) -> int:
        return len(self._starts["truth_start"]) - 1

    def append(self, truth: GroundTruth, tracks: Tracks, pairs: Candidates) -> None:
        """Add a frame."""
        for start, count in zip(self._starts.values(), (len(truth), len(tracks), len(pairs.truth)), strict=True):
            start.append(start[-1] + count)
        paired = (pairs.truth, pairs.track, pairs.similarity)
        rows = (truth.id, truth.label, tracks.id, tracks.label, tracks.score, *paired)
        for column, values in zip(self._columns.values(), rows, strict=True):
            column.frombytes(np.asarray(values, dtype=column.typecode).tobytes())

    def flat(self) -> FlatLog:
        """All frames as flat arrays."""
        wide = {"q": np.int64, "b": np.int64, "i": np.int64, "d": np.float64}
        columns = {**self._starts, **self._columns}
        arrays: dict[str, Any] = {name: np.array(column, wide[column.typecode]) for name, column in columns.items()}
        return FlatLog(**arrays)


@dataclass(frozen=True, slots=True, eq=False)
class FlatLog:
    """A sequence as flat arrays; offsets (F + 1,) say where each frame begins.

    Attributes:
        truth_start: offsets into the truth.
        track_start: offsets into the tracks.
        pair_start: offsets into the pairs.
        truth_id: (G,).
        truth_label: (G,).
        track_id: (T,).
        track_label: (T,).
        score: (T,) of the tracks.
        pair_truth: (P,) rows within the frame.
        pair_track: (P,) rows within the frame.
        similarity: (P,).
    """

    truth_start: Ints
    track_start: Ints
    pair_start: Ints
    truth_id: Ints
    truth_label: Ints
    track_id: Ints
    track_label: Ints
    score: Floats
    pair_truth: Ints
    pair_track: Ints
    similarity: Floats

    @property
    def labels(self) -> Ints:
        """The classes that occur in the truth, sorted."""
        return np.unique(self.truth_label)

    def only(self, label: int) -> FlatLog:
        """The part of one class."""
        truth, track = self.truth_label == label, self.track_label == label
        frame = np.repeat(np.arange(len(self.pair_start) - 1), np.diff(self.pair_start))
        truth_row, track_row = self.truth_start[frame] + self.pair_truth, self.track_start[frame] + self.pair_track
        pair = truth[truth_row]  # pairs are of one class, so the track's is the same
        return FlatLog(
            truth_start=_starts(_per_frame(truth, self.truth_start)),
            track_start=_starts(_per_frame(track, self.track_start)),
            pair_start=_starts(_per_frame(pair, self.pair_start)),
            truth_id=self.truth_id[truth],
            truth_label=self.truth_label[truth],
            track_id=self.track_id[track],
            track_label=self.track_label[track],
            score=self.score[track],
            pair_truth=_rows_after(truth, self.truth_start)[truth_row][pair],
            pair_track=_rows_after(track, self.track_start)[track_row][pair],
            similarity=self.similarity[pair],
        )

    def numbered(self) -> tuple[SequenceArrays, int, Floats]:
        """What the matching needs, the number of objects, and each track's mean score (tracks,)."""
        objects, truth = np.unique(self.truth_id, return_inverse=True)
        _, track, frames = np.unique(self.track_id, return_inverse=True, return_counts=True)
        mean_score = np.bincount(track, weights=self.score) / frames
        arrays = SequenceArrays(
            self.truth_start,
            truth,
            self.track_start,
            track,
            self.pair_start,
            self.pair_truth,
            self.pair_track,
            self.similarity,
        )
        return arrays, len(objects), mean_score


def _starts(lengths: NDArray[np.integer[Any]] | NDArray[np.bool_]) -> Ints:
    """Offsets (N + 1,) of N parts of these lengths."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])


def _per_frame(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """How many are kept in each frame."""
    return np.diff(_starts(kept)[start])


def _rows_after(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """The row within its frame that each kept element has once the others are gone."""
    total = _starts(kept)
    frame = np.repeat(np.arange(len(start) - 1), np.diff(start))
    rows: Ints = total[:-1] - total[start[frame]]
    return rows
