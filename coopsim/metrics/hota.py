"""HOTA: detection and association with equal weight, over 19 thresholds (Luiten et al., "HOTA", IJCV 2021).

As in TrackEval, each frame is matched once, for the largest sum of similarity times the alignment of object and track
over the whole sequence; the matches are then cut at each threshold alpha.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.metrics.cooccurrence import Cooccurrence
from coopsim.metrics.matching import NumberedSequence, SequenceArrays, match_frame
from coopsim.support.kernels import njit

ALPHAS = np.arange(1, 20) / 20
"""Thresholds of similarity, 0.05 to 0.95."""

_ROUNDING = np.finfo(float).eps


@dataclass(frozen=True, slots=True, eq=False)
class Hota:
    """Counts at each alpha, over any number of sequences. The properties are means over alpha, in [0, 1].

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
