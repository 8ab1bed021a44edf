"""Validity of detections for trackers; invalid ones are dropped on input."""

from __future__ import annotations

import numpy as np

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
    """Drop invalid detections, those of a class that no report can name, and those beyond `FARTHEST_M`.

    Args:
        detections: in an agent's base frame.
    """
    found = drop_invalid(detections)
    good = (found.label >= 0) & (found.label < len(CLASS_NAMES))
    good &= (np.abs(found.boxes.center) <= FARTHEST_M).all(axis=1)
    return found if good.all() else found[good]
