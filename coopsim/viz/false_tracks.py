"""False tracks: reported objects where nothing is, which pictures draw so that nobody takes them for true ones."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Mask

BESIDE_M = 2.0
"""Distance on the ground from an object's outline up to which a track counts as one of it, as in metrics of lies."""


def is_false(tracks: Floats, bodies: Floats) -> Mask:
    """Return the mask (M,) of tracks whose middle is on no body, nor beside one.

    Args:
        tracks: (M, 5) x, y, length, width, m, and yaw, rad.
        bodies: (N, 5) of all that is there, in the same frame; rows of NaN are left out.
    """
    there = bodies[np.isfinite(bodies).all(axis=1)]
    near: Mask = np.any(apart_m(tracks, there) <= BESIDE_M, axis=1)
    return ~near


def apart_m(tracks: Floats, bodies: Floats) -> Floats:
    """Return the distances (M, N) of the middles of tracks (M, 5) from the outlines of bodies (N, 5); 0 inside."""
    apart = tracks[:, None, :2] - bodies[None, :, :2]
    cos, sin = np.cos(bodies[:, 4]), np.sin(bodies[:, 4])
    along, across = apart[..., 0] * cos + apart[..., 1] * sin, apart[..., 1] * cos - apart[..., 0] * sin
    beyond = np.maximum(np.abs(np.stack([along, across], axis=-1)) - bodies[:, 2:4] / 2, 0.0)
    found: Floats = np.hypot(beyond[..., 0], beyond[..., 1])
    return found
