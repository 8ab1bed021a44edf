"""Points in seven bytes: centimetres in 16 bits, intensities in 8.

Clips hold points that were rounded so already: a clip from a folder is then, bit by bit, the clip that was stored. A
centimetre is less than the range noise of any LiDAR here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError

_PER_M = np.float32(100.0)
_PER_INTENSITY = np.float32(255.0)
MOST_M = 327.0
"""Farthest coordinate of a point."""


def pack_points(points: NDArray[np.float32]) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
    """Return the coordinates of points as (P, 3) cm and their intensities as (P,) 255ths.

    Args:
        points: (P, 4) x, y, z m and intensity in [0, 1].

    Raises:
        InvalidValueError: a coordinate is beyond 327 m or not finite, or an intensity is not in [0, 1].
    """
    far, intensity = np.abs(points[:, :3]), points[:, 3]
    if not ((far <= MOST_M).all() and ((intensity >= 0) & (intensity <= 1)).all()):
        raise InvalidValueError(f"points of clips must be within {MOST_M:g} m, with intensities in [0, 1]")
    return np.rint(points[:, :3] * _PER_M).astype(np.int16), np.rint(intensity * _PER_INTENSITY).astype(np.uint8)


def unpack_points(centimetres: NDArray[np.int16], intensity: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return packed points as (P, 4) float32: x, y, z m and intensity."""
    points = np.empty((len(centimetres), 4), np.float32)
    points[:, :3] = centimetres / _PER_M
    points[:, 3] = intensity / _PER_INTENSITY
    return points


def round_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return points as they are once packed and unpacked; raises as `pack_points` does."""
    return unpack_points(*pack_points(points))
