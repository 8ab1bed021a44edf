"""Beam tables: where the beams of spinning LiDARs point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.arrays import frozen, require_finite
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.registry import Registry


@dataclass(frozen=True, slots=True, eq=False)
class BeamPattern:
    """The elevations of a LiDAR's beams, all fired once per column.

    Attributes:
        name: the sensor's.
        elevation_rad: (B,), positive upwards.
    """

    name: str
    elevation_rad: Floats

    def __post_init__(self) -> None:
        elevation = frozen(self.elevation_rad, (None,), np.float64, "elevation_rad")
        require_finite(elevation, "elevation_rad")
        if not len(elevation) or np.abs(elevation).max() >= np.pi / 2:
            raise InvalidValueError("elevation_rad must have at least one beam, all within (-pi/2, pi/2)")
        object.__setattr__(self, "elevation_rad", elevation)

    def directions(self, columns: int) -> Floats:
        """(B * columns, 3) unit vectors in the sensor's frame, beam by beam, counter-clockwise from x."""
        azimuth = np.arange(columns) * (2 * np.pi / columns)
        elevation = self.elevation_rad[:, None]
        x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
        z = np.broadcast_to(np.sin(elevation), x.shape)
        return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def _evenly(name: str, top_deg: float, bottom_deg: float, beams: int) -> BeamPattern:
    return BeamPattern(name, np.radians(np.linspace(top_deg, bottom_deg, beams)))


def _hdl_64e() -> BeamPattern:
    """Velodyne's manual: an upper block of 32 beams a third of a degree apart, a lower one half a degree apart."""
    upper, lower = np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)
    return BeamPattern("HDL-64E", np.radians(np.concatenate([upper, lower])))


PATTERNS: Registry[BeamPattern] = Registry("LiDAR")
"""Beam tables from the makers' data sheets: Velodyne VLP-16, HDL-32E, HDL-64E."""

for _pattern in (
    _evenly("VLP-16", 15.0, -15.0, 16),
    _evenly("HDL-32E", 10.67, -30.67, 32),
    _hdl_64e(),
):
    PATTERNS.register(_pattern.name)(_pattern)
