"""Validity of what trackers are given: detections, of which invalid ones are dropped on input, and embeddings."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coopsim.support.arrays import frozen
from coopsim.types import Mask
from coopsim.types.estimates import Detections
from coopsim.types.taxonomy import CLASS_NAMES

FARTHEST_M = 10_000.0
"""Largest accepted distance from an agent along any axis: beyond the reach of every sensor and radio."""


def drop_invalid(detections: Detections) -> Detections:
    """Drop detections that cannot be tracked: not finite box, score or covariance, or a size that is not positive."""
    boxes = detections.boxes
    valid = np.isfinite(boxes.array).all(axis=1) & np.isfinite(detections.score) & (boxes.size > 0).all(axis=1)
    if detections.covariance is not None:
        valid &= np.isfinite(detections.covariance).all(axis=(1, 2))
    return detections if valid.all() else detections[valid]


def drop_unreportable(detections: Detections) -> Detections:
    """Drop detections that are invalid, of an unknown class, or beyond `FARTHEST_M` from the agent."""
    found = drop_invalid(detections)
    good = (found.label >= 0) & (found.label < len(CLASS_NAMES))
    good &= (np.abs(found.boxes.center) <= FARTHEST_M).all(axis=1)
    return found if good.all() else found[good]


def normalize_embeddings(
    embeddings: ArrayLike, shape: tuple[int | None, int | None] = (None, None)
) -> tuple[NDArray[np.float32], Mask]:
    """Normalize embeddings (M, D), of which only the directions mean anything, to unit length.

    Returns the unit vectors (M, D), and a mask (M,) of the rows that are valid (finite and not all zeros); invalid rows
    become zeros. Raises for another shape than the known parts of `shape`.
    """
    given = frozen(embeddings, shape, np.float64, "embeddings")
    # Divided by the largest element first: squares of very large or small ones would leave the range.
    largest = np.abs(given).max(axis=1, keepdims=True, initial=0.0)
    valid = np.isfinite(largest) & (largest > 0)
    scaled = np.where(valid, given, 0.0) / np.where(valid, largest, 1.0)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return (scaled / np.where(valid, length, 1.0)).astype(np.float32), valid[:, 0]
