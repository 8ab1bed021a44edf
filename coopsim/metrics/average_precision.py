"""Average precision of reported boxes, frame by frame; identities do not matter.

Boxes are taken from the surest to the least sure; each gets the most similar object of its frame that is still
free, as in OpenCOOD. The area under the curve of precision over recall is PASCAL VOC's since 2010: every precision is
raised to the best at any higher recall.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.metrics.matching import NumberedSequence, SequenceArrays, frame_of
from coopsim.types import Ints

AP_THRESHOLDS = (0.3, 0.5, 0.7)


def average_precision(sequences: Iterable[tuple[NumberedSequence, Floats]]) -> float:
    """Average precision over sequences, in [0, 1]; 0 where there is no object.

    Args:
        sequences: each with the pairs at or above the threshold, and the score of every reported box (T,).
    """
    truth, hits, scores = 0, [np.zeros(0, dtype=bool)], [np.zeros(0)]
    for sequence, score in sequences:
        data = sequence.arrays
        truth += len(data.truth)
        hits.append(_surest_first(data, np.lexsort((-score, frame_of(data.track_start)))))
        scores.append(score)
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return _area(np.concatenate(hits)[order], truth)


def _area(hits: NDArray[np.bool_], truth: int) -> float:
    """Area under the curve that ranked hits and misses make."""
    true = np.cumsum(hits)
    precision = true / np.arange(1, len(hits) + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    return float(best_from_here[hits].sum()) / max(truth, 1)


@njit(cache=True, nogil=True)
def _surest_first(data: SequenceArrays, order: Ints) -> NDArray[np.bool_]:
    """Which reported boxes (T,) get an object when served in an order that goes frame by frame."""
    hits = np.zeros(len(data.track), np.bool_)
    for frame in range(len(data.track_start) - 1):
        first, end = data.pair_start[frame], data.pair_start[frame + 1]
        free = np.ones(data.truth_start[frame + 1] - data.truth_start[frame], np.bool_)
        for box in order[data.track_start[frame] : data.track_start[frame + 1]]:
            best = -1
            for pair in range(first, end):
                if data.pair_track[pair] + data.track_start[frame] != box or not free[data.pair_truth[pair]]:
                    continue
                if best < 0 or data.pair_similarity[pair] > data.pair_similarity[best]:
                    best = pair
            if best >= 0:
                free[data.pair_truth[best]] = False
                hits[box] = True
    return hits
