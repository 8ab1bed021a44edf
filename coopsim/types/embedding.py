"""Embeddings: vectors that describe the appearance of objects. Only their directions mean anything."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.support.arrays import frozen
from coopsim.types import Mask


def normalize_embeddings(
    embeddings: ArrayLike, shape: tuple[int | None, int | None] = (None, None)
) -> tuple[NDArray[np.float32], Mask]:
    """Normalize embeddings to unit length.

    Args:
        embeddings: (M, D).
        shape: M and D, where they are known.

    Returns:
        The unit vectors (M, D), and a mask (M,) of the rows that are valid (finite and not all zeros); invalid rows
        become zeros.

    Raises:
        InvalidValueError: they have another shape.
    """
    given = frozen(embeddings, shape, np.float64, "embeddings")
    # Divided by the largest element first: squares of very large or small ones would leave the range.
    largest = np.abs(given).max(axis=1, keepdims=True, initial=0.0)
    valid = np.isfinite(largest) & (largest > 0)
    scaled = np.where(valid, given, 0.0) / np.where(valid, largest, 1.0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return (scaled / np.where(valid, length, 1.0)).astype(np.float32), valid[:, 0]
