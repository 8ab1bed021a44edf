"""HOTA: detection and association weighed alike, over 19 thresholds (Luiten et al., "HOTA", IJCV 2021).

Follows TrackEval: each frame is matched once, for the largest sum of similarity times how well object and track are
aligned over the whole sequence; the matches are then cut at each threshold alpha.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.metrics.cooccurrence import Couples
from coopsim.metrics.matching import NumberedSequence, SequenceArrays, match_frame

ALPHAS = np.arange(1, 20) / 20
"""Thresholds of similarity, 0.05 to 0.95."""

_ROUNDING = np.finfo(float).eps


@dataclass(frozen=True, slots=True, eq=False)
class Hota:
    """Counts at each alpha, over any number of sequences; what follows from them are means over alpha, in [0, 1].

    Attributes:
        tp: (19,) matched pairs.
        truth: number of truth boxes.
        reported: number of reported boxes.
        association: (19,) sum over matched pairs of how well object and track are associated.
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
        """Localisation accuracy: mean similarity of matched pairs; as in TrackEval, 1 where there is none."""
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
    """Counts over sequences; their pairs are all those with any similarity."""
    tp, association, similarity = np.zeros((3, len(ALPHAS)))
    truth = reported = 0
    for sequence in sequences:
        data = sequence.arrays
        truth, reported = truth + len(data.truth), reported + len(data.track)
        couples = Couples.of(sequence)
        weight = _alignment(data, couples)[couples.of_pair] * data.pair_similarity
        matched = _match(data, weight)
        for a, alpha in enumerate(ALPHAS):
            hit = matched[data.pair_similarity[matched] >= alpha - _ROUNDING]
            together = np.bincount(couples.of_pair[hit], minlength=len(couples))
            tp[a] += len(hit)
            association[a] += (together**2 / np.maximum(1, couples.frames - together)).sum()
            similarity[a] += data.pair_similarity[hit].sum()
    return Hota(tp, truth, reported, association, similarity)


def _alignment(data: SequenceArrays, couples: Couples) -> Floats:
    """(C,) how well each couple is aligned over the sequence: a Jaccard index of soft counts.

    A pair of a frame counts with its similarity's share of all that its object and its track have there.
    """
    object_sum = np.bincount(couples.truth_row, data.pair_similarity, len(data.truth))[couples.truth_row]
    track_sum = np.bincount(couples.track_row, data.pair_similarity, len(data.track))[couples.track_row]
    share = data.pair_similarity / (object_sum + track_sum - data.pair_similarity)
    together = np.bincount(couples.of_pair, share, len(couples))
    aligned: Floats = together / (couples.frames - together)
    return aligned


@njit(cache=True, nogil=True)
def _match(data: SequenceArrays, weight: Floats) -> NDArray[np.int64]:
    """Indices of the matched pairs: in each frame one to one, with the largest sum of weights (P,)."""
    matched = np.empty(len(data.truth), np.int64)
    count = 0
    for frame in range(len(data.truth_start) - 1):
        first, end = data.pair_start[frame], data.pair_start[frame + 1]
        chosen = match_frame(
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
