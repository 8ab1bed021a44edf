"""Poses of KITTI's inertial unit, from its measurements of latitude, longitude, altitude and angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3, Floats

EARTH_M = 6378137.0
"""Radius of the sphere on which latitudes and longitudes are projected."""

_FIELDS = 6  # of those that are used: latitude, longitude, altitude, roll, pitch, yaw


def read_gps_poses(path: Path) -> list[SE3]:
    """Read `world_SE3_imu` of every frame; the world's x points east, y north, its origin is the first position.

    A line is a frame: latitude and longitude (degrees), altitude m, roll, pitch, yaw rad (x forward, y left, z up; 0 is
    east), and more. Positions are those of the Mercator projection, scaled by the cosine of the first latitude, as
    KITTI's own development kit has them:

        x = s R longitude,   y = s R log tan(pi/4 + latitude/2),   s = cos(first latitude).

    Raises:
        RecordingError: the file is missing, empty, or has a broken line, which is named.
    """
    rows = _read(path)
    latitude, longitude = np.radians(rows[:, 0]), np.radians(rows[:, 1])
    scale = EARTH_M * np.cos(latitude[0])
    place = np.column_stack([scale * longitude, scale * np.log(np.tan(np.pi / 4 + latitude / 2)), rows[:, 2]])
    return [SE3(_turn(*angles), at) for angles, at in zip(rows[:, 3:], place - place[0], strict=True)]


def _read(path: Path) -> Floats:
    try:
        lines = path.read_text(encoding="utf-8").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        try:
            row = [float(word) for word in line.split()[:_FIELDS]]
        except ValueError as error:
            raise RecordingError(f"{path}, line {number}: {error}") from None
        if len(row) < _FIELDS or not np.isfinite(row).all() or abs(row[0]) >= 90:
            raise RecordingError(
                f"{path}, line {number}: latitude, longitude, altitude, roll, pitch and yaw are needed, finite and "
                f"with a latitude between -90 and 90, got {' '.join(line.split()[:_FIELDS])!r}"
            )
        rows.append(row)
    if not rows:
        raise RecordingError(f"{path} is empty: it needs a line for each frame")
    return np.array(rows)


def _turn(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
