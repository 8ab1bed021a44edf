"""What is kept of a sequence for scoring: who was where, and which pairs could be matches. No boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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
    rows, columns = np.nonzero(similarity >= match_iou)
    return Candidates(rows, columns, similarity[rows, columns])


@dataclass(slots=True)
class TrackLog:
    """One sequence of one agent, frame by frame.

    Attributes:
        match_iou: the threshold of the candidates.
    """

    match_iou: float
    _truth: list[tuple[Ints, Ints]] = field(default_factory=list)
    _tracks: list[tuple[Ints, Ints, Floats]] = field(default_factory=list)
    _pairs: list[Candidates] = field(default_factory=list)

    def __post_init__(self) -> None:
        require_threshold(match_iou=self.match_iou)

    def __len__(self) -> int:
        return len(self._truth)

    def append(self, truth: GroundTruth, tracks: Tracks, pairs: Candidates) -> None:
        """Add a frame."""
        self._truth.append((truth.id, truth.label))
        self._tracks.append((tracks.id, tracks.label, tracks.score))
        self._pairs.append(pairs)

    def flat(self) -> FlatLog:
        """All frames as flat arrays."""
        truth, tracks, pairs = self._truth, self._tracks, self._pairs
        return FlatLog(
            truth_start=_starts([len(ids) for ids, _ in truth]),
            track_start=_starts([len(ids) for ids, _, _ in tracks]),
            pair_start=_starts([len(pair.truth) for pair in pairs]),
            truth_id=_join([ids for ids, _ in truth], np.int64),
            truth_label=_join([label for _, label in truth], np.int64),
            track_id=_join([ids for ids, _, _ in tracks], np.int64),
            track_label=_join([label for _, label, _ in tracks], np.int64),
            score=_join([score for _, _, score in tracks], np.float64),
            pair_truth=_join([pair.truth for pair in pairs], np.int64),
            pair_track=_join([pair.track for pair in pairs], np.int64),
            similarity=_join([pair.similarity for pair in pairs], np.float64),
        )


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


def _join(parts: Sequence[NDArray[Any]], dtype: type[Any]) -> NDArray[Any]:
    return np.concatenate([np.zeros(0, dtype=dtype), *parts])


def _starts(lengths: Sequence[int] | Ints) -> Ints:
    return np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)]).astype(np.int64)


def _per_frame(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """How many are kept in each frame."""
    return np.diff(_starts(kept.astype(np.int64))[start])


def _rows_after(kept: NDArray[np.bool_], start: Ints) -> Ints:
    """The row within its frame that each kept element has once the others are gone."""
    total = _starts(kept.astype(np.int64))
    frame = np.repeat(np.arange(len(start) - 1), np.diff(start))
    rows: Ints = total[:-1] - total[start[frame]]
    return rows
