"""Which way tracks face: detectors confuse front and back, motion does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Tracks

MOVING_M_S = 2.0
"""What is faster faces where it goes."""


def facing_forwards(tracks: Tracks) -> Tracks:
    """Return tracks, those that move (2 m/s) and face backwards turned around; others face as they did."""
    (x, y), yaw_rad = tracks.velocity.T, tracks.boxes.array[:, 6]
    backwards = (np.hypot(x, y) > MOVING_M_S) & (np.cos(yaw_rad) * x + np.sin(yaw_rad) * y < 0)
    if not backwards.any():
        return tracks
    boxes = tracks.boxes.array.copy()
    boxes[backwards, 6] += np.pi
    return replace(tracks, boxes=Boxes3D.from_array(boxes))
