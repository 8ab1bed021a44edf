"""How well a similarity tells pairs of one object from pairs of two."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import rankdata


def separation(similarity: ArrayLike, same: ArrayLike) -> float:
    """Return the probability that a pair of one object is more similar than a pair of two: the area under the ROC.

    1 tells all apart, 0.5 is chance; equal similarities count half. NaN without pairs of both kinds.

    Args:
        similarity: (K,) of pairs.
        same: (K,) bool, which pairs are of one object.
    """
    same = np.asarray(same, dtype=bool)
    alike, unlike = int(same.sum()), int((~same).sum())
    if not alike or not unlike:
        return math.nan
    ranks = rankdata(np.asarray(similarity, dtype=np.float64))
    return float((ranks[same].sum() - alike * (alike + 1) / 2) / (alike * unlike))
