"""Embeddings: vectors that say what an object looks like. Only their directions mean anything."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.support.arrays import frozen
from coopsim.types import Mask


def directions(
    embeddings: ArrayLike, shape: tuple[int | None, int | None] = (None, None)
) -> tuple[NDArray[np.float32], Mask]:
    """Each of M embeddings (M, D) at length 1, and which of them are any, (M,).

    One that is not finite, or all zeros, is none: its direction is zeros.

    Args:
        embeddings: (M, D).
        shape: M and D, where they are known.

    Raises:
        InvalidValueError: they have another shape.
    """
    given = frozen(embeddings, shape, np.float64, "embeddings")
    # Divided by the largest element first: squares of very large or small ones would leave the range.
    largest = np.abs(given).max(axis=1, keepdims=True, initial=0.0)
    present = np.isfinite(largest) & (largest > 0)
    scaled = np.where(present, given, 0.0) / np.where(present, largest, 1.0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return (scaled / np.where(present, length, 1.0)).astype(np.float32), present[:, 0]
