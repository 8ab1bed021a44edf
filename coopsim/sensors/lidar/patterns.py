"""Beam tables: the directions of spinning LiDARs' beams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.calibrations import (
    HDL_64E_ELEVATION_DEG,
    HDL_64E_LEFT_DEG,
    OS1_128_CLOCKWISE_DEG,
    OS1_128_ELEVATION_DEG,
)
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.registry import Registry


@dataclass(frozen=True, slots=True, eq=False)
class BeamPattern:
    """The beam table of a LiDAR; all beams are fired once per column.

    Attributes:
        name: of the sensor.
        elevation_rad: (B,), positive upwards, in any order and spacing.
        azimuth_rad: (B,) angle of each beam to the left of its column (counter-clockwise from above); None: all zero.
    """

    name: str
    elevation_rad: Floats
    azimuth_rad: Floats | None = None

    def __post_init__(self) -> None:
        elevation = frozen(self.elevation_rad, (None,), np.float64, "elevation_rad")
        require_finite(elevation, "elevation_rad")
        if not len(elevation) or np.abs(elevation).max() >= np.pi / 2:
            raise InvalidValueError("elevation_rad must have at least one beam, all within (-pi/2, pi/2)")
        object.__setattr__(self, "elevation_rad", elevation)
        if self.azimuth_rad is not None:
            azimuth = frozen(self.azimuth_rad, (len(elevation),), np.float64, "azimuth_rad")
            require_finite(azimuth, "azimuth_rad")
            if np.abs(azimuth).max() > np.pi:
                raise InvalidValueError("azimuth_rad must be within [-pi, pi]")
            object.__setattr__(self, "azimuth_rad", azimuth)

    @property
    def offset_rad(self) -> Floats:
        """`azimuth_rad`, zeros if None, (B,)."""
        return np.zeros(len(self.elevation_rad)) if self.azimuth_rad is None else self.azimuth_rad

    def directions(self, columns: int) -> Floats:
        """Return unit vectors (B * columns, 3) in the sensor's frame, beam by beam, counter-clockwise from x."""
        azimuth = np.arange(columns) * (2 * np.pi / columns) + self.offset_rad[:, None]
        elevation = self.elevation_rad[:, None]
        x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
        z = np.broadcast_to(np.sin(elevation), x.shape)
        return np.stack([x, y, z], axis=-1).reshape(-1, 3)


PATTERNS: Registry[BeamPattern] = Registry("beam table")
"""Beam tables of real sensors, by name: a model's design, or one unit's calibration if no design is published."""


def _register(name: str, elevation_deg: ArrayLike, clockwise_deg: ArrayLike | None = None) -> None:
    azimuth = None if clockwise_deg is None else -np.radians(clockwise_deg)
    PATTERNS.register(name)(BeamPattern(name, np.radians(elevation_deg), azimuth))


# Velodyne VLP-16 user manual (63-9243), table 9-1: 16 beams 2 degrees apart; VLP16db.yaml of the ROS driver velodyne
# has the same.
_register("VLP-16", np.linspace(15.0, -15.0, 16))

# Velodyne HDL-32E user manual (63-9113), firing order: 32 beams 4/3 degrees apart, rounded to hundredths, from which
# these are at most 0.01 degrees off, as from 32db.yaml of the ROS driver.
_register("HDL-32E", np.linspace(10.67, -30.67, 32))

# One unit's calibration each.
_register("HDL-64E", HDL_64E_ELEVATION_DEG, -HDL_64E_LEFT_DEG)
_register("OS1-128", OS1_128_ELEVATION_DEG, OS1_128_CLOCKWISE_DEG)

# Hesai Pandar64, the design: pandarGeneral_internal.cc of Hesai's open driver. Beams are 1/6 degree apart around the
# horizon, up to 6 degrees at the ends; fired in groups with azimuth offsets, clockwise positive. Channel 58 is
# corrected from the driver's -9.885: the driver's angle_correction_Pandar64.csv has every channel 0.079 lower but this
# one 0.239 lower, and a unit's file in Hesai's SDK 2.0 (Pandar64E3X) has -10.084 between -9.080 and -11.052.
_PANDAR64 = """
    14.882 11.032 8.059 5.057 3.04 2.028 1.86 1.688 1.522 1.351 1.184 1.013 0.846 0.675 0.508 0.337 0.169 0 -0.169
    -0.337 -0.508 -0.675 -0.845 -1.013 -1.184 -1.351 -1.522 -1.688 -1.86 -2.028 -2.198 -2.365 -2.536 -2.7 -2.873 -3.04
    -3.21 -3.375 -3.548 -3.712 -3.884 -4.05 -4.221 -4.385 -4.558 -4.72 -4.892 -5.057 -5.229 -5.391 -5.565 -5.726 -5.898
    -6.061 -7.063 -8.059 -9.06 -10.045 -11.032 -12.006 -12.974 -13.93 -18.889 -24.897"""
_register(
    "Pandar64",
    np.array(_PANDAR64.split(), dtype=np.float64),
    [*[-1.042] * 6, *[1.042, 3.125, 5.208, -5.208, -3.125, -1.042] * 8, *[-1.042] * 10],
)
