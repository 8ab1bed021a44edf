"""HOTA and the identity metrics: how well a track keeps to one object over a whole sequence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coopsim.geometry.assignment import match_pairs
from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import NumberedSequence, SequenceArrays, frame_of
from coopsim.support.kernels import njit
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class Cooccurrence:
    """The C distinct combinations of an object and a track among the P candidate pairs of a sequence.

    C is far smaller than the number of objects times the number of tracks.

    Attributes:
        object: (C,) number of the object.
        track: (C,) number of the track.
        frames: (C,) frames of the object plus frames of the track.
        of_pair: (P,) the combination of each pair.
        truth_row: (P,) row of each pair's truth box in the sequence.
        track_row: (P,) row of each pair's reported box in the sequence.
    """

    object: Ints
    track: Ints
    frames: Ints
    of_pair: Ints
    truth_row: Ints
    track_row: Ints

    @classmethod
    def of(cls, sequence: NumberedSequence) -> Cooccurrence:
        """Find the combinations of a sequence."""
        data, tracks = sequence.arrays, max(len(sequence.mean_score), 1)
        frame = frame_of(data.pair_start)
        truth_row, track_row = data.truth_start[frame] + data.pair_truth, data.track_start[frame] + data.pair_track
        key, of_pair = np.unique(data.truth[truth_row] * tracks + data.track[track_row], return_inverse=True)
        object_, track = np.divmod(key, tracks)
        frames = np.bincount(data.truth, minlength=1)[object_] + np.bincount(data.track, minlength=1)[track]
        return cls(object_, track, frames, of_pair, truth_row, track_row)

    def __len__(self) -> int:
        return len(self.object)


ALPHAS = np.arange(1, 20) / 20
"""Thresholds of similarity, 0.05 to 0.95."""

_ROUNDING = np.finfo(float).eps


@dataclass(frozen=True, slots=True, eq=False)
class Hota:
    """HOTA's counts at 19 thresholds (Luiten et al., IJCV 2021). The properties are means over alpha, in [0, 1].

    As in TrackEval, each frame is matched once, for the largest sum of similarity times the alignment of object and
    track over the whole sequence; the matches are then cut at each threshold alpha.

    Attributes:
        tp: (19,) matched pairs.
        truth: number of truth boxes.
        reported: number of reported boxes.
        association: (19,) sum over matched pairs of TPA / (TPA + FNA + FPA) of their object and track.
        similarity: (19,) sum over matched pairs.
    """

    tp: Floats
    truth: int
    reported: int
    association: Floats
    similarity: Floats

    @property
    def hota(self) -> float:
        """Mean of the square root of DetA times AssA at each alpha."""
        return float(np.sqrt(self._detection * self._association).mean())

    @property
    def det_a(self) -> float:
        """Detection accuracy: TP / (TP + FN + FP)."""
        return float(self._detection.mean())

    @property
    def ass_a(self) -> float:
        """Association accuracy: mean over matched pairs of TPA / (TPA + FNA + FPA)."""
        return float(self._association.mean())

    @property
    def loc_a(self) -> float:
        """Localisation accuracy: mean similarity of matched pairs; 1 without matches, as in TrackEval."""
        return float(np.divide(self.similarity, self.tp, out=np.ones(len(ALPHAS)), where=self.tp > 0).mean())

    @property
    def _detection(self) -> Floats:
        value: Floats = self.tp / np.maximum(1, self.truth + self.reported - self.tp)
        return value

    @property
    def _association(self) -> Floats:
        value: Floats = self.association / np.maximum(1, self.tp)
        return value


def count_hota(sequences: Iterable[NumberedSequence]) -> Hota:
    """Count over sequences, whose pairs are all those with a positive similarity."""
    tp, association, similarity = np.zeros((3, len(ALPHAS)))
    truth = reported = 0
    for sequence in sequences:
        data = sequence.arrays
        truth, reported = truth + len(data.truth), reported + len(data.track)
        combinations = Cooccurrence.of(sequence)
        weight = _alignment(data, combinations)[combinations.of_pair] * data.pair_similarity
        matched = _match(data, weight)
        for a, alpha in enumerate(ALPHAS):
            hit = matched[data.pair_similarity[matched] >= alpha - _ROUNDING]
            together = np.bincount(combinations.of_pair[hit], minlength=len(combinations))
            tp[a] += len(hit)
            association[a] += (together**2 / np.maximum(1, combinations.frames - together)).sum()
            similarity[a] += data.pair_similarity[hit].sum()
    return Hota(tp, truth, reported, association, similarity)


def _alignment(data: SequenceArrays, combinations: Cooccurrence) -> Floats:
    """Compute the alignment (C,) of each object and track over the sequence: a Jaccard index of soft counts.

    A pair of a frame counts with its similarity's share of all similarity that its object and its track have there.
    """
    object_sum = np.bincount(combinations.truth_row, data.pair_similarity, len(data.truth))[combinations.truth_row]
    track_sum = np.bincount(combinations.track_row, data.pair_similarity, len(data.track))[combinations.track_row]
    share = data.pair_similarity / (object_sum + track_sum - data.pair_similarity)
    together = np.bincount(combinations.of_pair, share, len(combinations))
    aligned: Floats = together / (combinations.frames - together)
    return aligned


@njit(cache=True, nogil=True)
def _match(data: SequenceArrays, weight: Floats) -> NDArray[np.int64]:
    """Match each frame one to one for the largest sum of weights (P,). Return the indices of the matched pairs."""
    matched = np.empty(len(data.truth), np.int64)
    count = 0
    for frame in range(len(data.truth_start) - 1):
        first, end = data.pair_start[frame], data.pair_start[frame + 1]
        chosen = match_pairs(
            data.truth_start[frame + 1] - data.truth_start[frame],
            data.track_start[frame + 1] - data.track_start[frame],
            data.pair_truth[first:end],
            data.pair_track[first:end],
            weight[first:end],
        )
        for pair in chosen:
            if pair >= 0:
                matched[count] = first + pair
                count += 1
    return matched[:count]


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity counts, with at most one track for each object's whole life (Ristani et al., ECCVW 2016).

    Attributes:
        tp: boxes of objects on which the object's assigned track is.
        truth: number of truth boxes.
        reported: number of reported boxes.
    """

    tp: int
    truth: int
    reported: int

    @property
    def precision(self) -> float:
        """IDP = IDTP / (IDTP + IDFP)."""
        return self.tp / max(self.reported, 1)

    @property
    def recall(self) -> float:
        """IDR = IDTP / (IDTP + IDFN)."""
        return self.tp / max(self.truth, 1)

    @property
    def f1(self) -> float:
        """IDF1 = 2 IDTP / (2 IDTP + IDFP + IDFN)."""
        return 2 * self.tp / max(self.truth + self.reported, 1)


def count_identity(sequences: Iterable[NumberedSequence]) -> Identity:
    """Count over sequences, whose pairs are those of a track on an object."""
    tp = truth = reported = 0
    for sequence in sequences:
        truth, reported = truth + len(sequence.arrays.truth), reported + len(sequence.arrays.track)
        tp += _best_assignment(sequence)
    return Identity(tp, truth, reported)


def _best_assignment(sequence: NumberedSequence) -> int:
    """Assign tracks to objects so that the frames they spend together are most. Return the number of these frames."""
    combinations = Cooccurrence.of(sequence)
    together = np.bincount(combinations.of_pair, minlength=len(combinations))
    # Each connected group on its own: a tracker with a new id in every frame makes one huge assignment otherwise.
    shape = (sequence.objects + len(sequence.mean_score),) * 2
    edges = coo_array((together, (combinations.object, sequence.objects + combinations.track)), shape=shape)
    _, group = connected_components(edges, directed=False)
    group = group[combinations.object]
    order = np.argsort(group, kind="stable")
    borders = np.flatnonzero(np.diff(group[order])) + 1
    return sum(
        _largest_sum(combinations.object[part], combinations.track[part], together[part])
        for part in np.split(order, borders)
    )


def _largest_sum(objects: Ints, tracks: Ints, together: Ints) -> int:
    """Solve the assignment of one connected group of C combinations."""
    _, row = np.unique(objects, return_inverse=True)
    _, column = np.unique(tracks, return_inverse=True)
    if not (row.any() and column.any()):  # one object, or one track: it gets the best
        return int(together.max(initial=0))
    gain = coo_array((together, (row, column))).toarray()
    return int(gain[linear_sum_assignment(gain, maximize=True)].sum())
