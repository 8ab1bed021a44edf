"""Pairs of sightings, of one object or of two, and how similar their vectors are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.learn.samples.sightings import Sightings
from coopsim.types import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSightings:
    """K pairs of sightings of objects of the same class.

    Attributes:
        similarity: (K,) cosine of their vectors.
        same: (K,) whether they are of the same object.
        label: (K,) the class.
        returns: (K,) LiDAR returns of the one that has fewer.
    """

    similarity: Floats
    same: Mask
    label: Ints
    returns: Ints


def compare_sightings(vectors: NDArray[np.floating], seen: Sightings, pairs: Mask) -> ComparedSightings:
    """Compare sightings of one clip.

    Args:
        vectors: (M, D) unit vectors.
        seen: M sightings.
        pairs: (M, M) symmetric: which pairs to compare, as `Sightings.across_agents`; of these, those of one class.
    """
    one, other = np.nonzero(np.triu(pairs & (seen.label[:, None] == seen.label), k=1))
    return ComparedSightings(
        np.einsum("kd,kd->k", vectors[one], vectors[other]).astype(np.float64),
        seen.identity[one] == seen.identity[other],
        seen.label[one],
        np.minimum(seen.returns[one], seen.returns[other]),
    )
