"""Beam tables: the directions of spinning LiDARs' beams, of real sensors by name, and from files.

A data sheet gives the first and the last beam. A unit's calibration gives all, and no two units have the same. All
beams are assumed to start in one point: the calibrations' offsets of a few centimetres (in the HDL-64E up to 0.22 m
upwards) and their corrections of range are left out.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from coopsim.config.yaml_file import read_yaml
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.checks import require_between, require_number
from coopsim.support.registry import Registry


def _numbers(text: str) -> Floats:
    return np.array(text.split(), dtype=np.float64)


# A Velodyne HDL-64E S3: `vert_correction` and `rot_correction` of params/64e_s3-xiesc.yaml in the ROS driver velodyne
# (since 2018, pull request 205), also the default of MRPT; to 0.001 degrees. As in the manual, the upper 32 beams are
# 1/3 degree apart and the lower 32 beams 1/2 degree. The driver subtracts rot_correction from a clockwise angle, so it
# is counted to the left.
HDL_64E_ELEVATION_DEG = _numbers("""
    1.96 1.562 1.293 0.895 0.591 0.204 -0.089 -0.452 -0.756 -1.143 -1.459 -1.81 -2.091 -2.488 -2.792 -3.119 -3.469
    -3.819 -4.157 -4.53 -4.809 -5.135 -5.483 -5.889 -6.19 -6.56 -6.849 -7.23 -7.552 -7.943 -8.219 -8.563 -8.775 -9.3
    -9.744 -10.176 -10.754 -11.295 -11.913 -12.294 -12.83 -13.163 -13.806 -14.291 -14.927 -15.385 -15.906 -16.274
    -16.801 -17.368 -17.964 -18.429 -18.923 -19.247 -19.892 -20.429 -21.064 -21.491 -21.976 -22.358 -22.966 -23.549
    -24.147 -24.555
""")
HDL_64E_LEFT_DEG = _numbers("""
    2.109 -0.11 -2.172 -4.388 5.683 3.441 1.334 -0.89 -2.94 -5.184 6.385 4.162 2.147 -0.107 -2.123 -4.34 5.613 3.405
    1.371 -0.871 -2.907 -5.133 6.485 4.214 2.191 -0.055 -2.253 -4.382 5.676 3.412 1.39 -0.876 2.899 -0.342 -3.685 -6.933
    8.335 5.073 1.664 -1.572 -4.884 -8.3 9.67 6.277 3.004 -0.39 -3.675 -7.112 8.521 5.178 1.824 -1.626 -4.989 -8.521
    9.944 6.538 3.11 -0.291 -3.812 -7.326 8.903 5.48 1.818 -1.613
""")

# An Ouster OS1-128, calibrated in 2022 (serial number 122246000293): `beam_altitude_angles` and `beam_azimuth_angles`
# of its metadata in the tests of Ouster's SDK (tests/metadata/3_0_1_os-122246000293.json, 2023). They span 42.4
# degrees, as in the data sheet of rev. 7, but 0.74 degrees lower; the beams are in four columns, 8 firings of 1024
# apart. The SDK subtracts the azimuths from a counter-clockwise angle, so they are counted clockwise.
OS1_128_ELEVATION_DEG = _numbers("""
    20.47 20.21 19.89 19.54 19.23 18.97 18.66 18.31 18 17.72 17.4 17.05 16.74 16.45 16.13 15.77 15.45 15.15 14.83 14.47
    14.15 13.85 13.52 13.17 12.83 12.52 12.19 11.83 11.5 11.18 10.85 10.5 10.14 9.82 9.49 9.14 8.79 8.45 8.13 7.76 7.42
    7.08 6.75 6.39 6.04 5.7 5.35 5 4.64 4.32 3.98 3.61 3.25 2.92 2.57 2.22 1.85 1.52 1.17 0.82 0.45 0.12 -0.24 -0.58
    -0.95 -1.28 -1.64 -1.97 -2.35 -2.69 -3.03 -3.37 -3.74 -4.1 -4.43 -4.77 -5.14 -5.49 -5.82 -6.17 -6.53 -6.88 -7.22
    -7.55 -7.91 -8.27 -8.6 -8.92 -9.28 -9.64 -9.97 -10.29 -10.65 -11.01 -11.33 -11.64 -12.01 -12.35 -12.69 -12.98 -13.34
    -13.69 -14.03 -14.32 -14.68 -15.02 -15.35 -15.63 -15.98 -16.34 -16.65 -16.93 -17.27 -17.63 -17.93 -18.21 -18.55
    -18.9 -19.2 -19.48 -19.81 -20.16 -20.46 -20.72 -21.05 -21.39 -21.68 -21.95
""")
OS1_128_CLOCKWISE_DEG = _numbers("""
    4.2 1.42 -1.37 -4.14 4.22 1.44 -1.37 -4.15 4.24 1.43 -1.36 -4.15 4.24 1.43 -1.36 -4.16 4.23 1.42 -1.37 -4.17 4.25
    1.43 -1.37 -4.16 4.24 1.42 -1.38 -4.18 4.24 1.42 -1.38 -4.18 4.24 1.41 -1.38 -4.18 4.23 1.41 -1.39 -4.19 4.22 1.4
    -1.39 -4.2 4.21 1.4 -1.4 -4.2 4.2 1.41 -1.4 -4.21 4.2 1.4 -1.41 -4.21 4.2 1.4 -1.41 -4.21 4.2 1.4 -1.42 -4.21 4.2
    1.4 -1.42 -4.22 4.2 1.39 -1.41 -4.22 4.2 1.38 -1.41 -4.23 4.2 1.38 -1.41 -4.24 4.2 1.39 -1.42 -4.23 4.2 1.38 -1.43
    -4.22 4.2 1.38 -1.42 -4.23 4.19 1.38 -1.42 -4.23 4.2 1.39 -1.43 -4.22 4.2 1.38 -1.42 -4.23 4.19 1.39 -1.43 -4.24
    4.19 1.38 -1.43 -4.23 4.2 1.38 -1.42 -4.24 4.2 1.38 -1.43 -4.24 4.19 1.37 -1.43 -4.24 4.19 1.37 -1.44 -4.25
""")


@dataclass(frozen=True, slots=True, eq=False)
class BeamPattern:
    """Beam table of a LiDAR; all beams are fired once per column.

    Attributes:
        name: the sensor's.
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

# Velodyne VLP-32C user manual (63-9325), table of elevation angles and azimuth offsets, as in VeloView-VLP-32C.yaml of
# the ROS driver. Beams are 1/3 degree apart around the horizon.
_VLP_32C_ELEVATION_DEG = _numbers("""
    -25 -1 -1.667 -15.639 -11.31 0 -0.667 -8.843 -7.254 0.333 -0.333 -6.148 -5.333 1.333 0.667 -4 -4.667 1.667 1 -3.667
    -3.333 3.333 2.333 -2.667 -3 7 4.667 -2.333 -2 15 10.333 -1.333
""")
_VLP_32C_CLOCKWISE_DEG = _numbers("""
    1.4 -4.2 1.4 -1.4 1.4 -1.4 4.2 -1.4 1.4 -4.2 1.4 -1.4 4.2 -1.4 4.2 -1.4 1.4 -4.2 1.4 -4.2 4.2 -1.4 1.4 -1.4 1.4
    -1.4 1.4 -4.2 4.2 -1.4 1.4 -1.4
""")
_register("VLP-32C", _VLP_32C_ELEVATION_DEG, _VLP_32C_CLOCKWISE_DEG)

# Two of them, one over the other, as in Argoverse 2 (Wilson et al., NeurIPS Datasets 2021): 64 beams over 40 degrees:
# the lower one hangs upside down. A unit that is turned over by its x axis has both angles of each beam reversed.
_register(
    "2x VLP-32C",
    np.concatenate([_VLP_32C_ELEVATION_DEG, -_VLP_32C_ELEVATION_DEG]),
    np.concatenate([_VLP_32C_CLOCKWISE_DEG, -_VLP_32C_CLOCKWISE_DEG]),
)

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


ELEVATION, AZIMUTH = "elevation_deg", "azimuth_deg"
SUFFIXES = (".csv", ".yaml", ".yml")

_CHECKS: dict[str, Callable[..., None]] = {
    ELEVATION: partial(require_number, "a number in (-90, 90)", lambda degrees: abs(degrees) < 90),
    AZIMUTH: partial(require_between, -180, 180),
}


def find_pattern(name: str) -> BeamPattern:
    """Return a beam table by its name in `PATTERNS` or, if it ends in .csv, .yaml or .yml, by its path."""
    if isinstance(name, str) and name.lower().endswith(SUFFIXES):
        return load_pattern(name)
    return PATTERNS.get(name)


def load_pattern(path: str | Path) -> BeamPattern:
    """Read a beam table.

    CSV: a header `elevation_deg` or `elevation_deg,azimuth_deg`, then a line for each beam. YAML: a mapping with the
    same keys, each a list with an entry for each beam. Elevation is positive upwards, azimuth to the left, as in
    `BeamPattern`.

    Raises:
        InvalidValueError: names the file, the line if known, and what is wrong.
    """
    path = Path(path)
    table = _from_csv(path) if path.suffix.lower() == ".csv" else _from_yaml(path)
    elevation, azimuth = table[ELEVATION], table.get(AZIMUTH)
    if not elevation:
        raise InvalidValueError(f"{path}: a beam table must have at least one beam, got none")
    if azimuth is not None and len(azimuth) != len(elevation):
        raise InvalidValueError(f"{path}: {len(elevation)} {ELEVATION} need as many {AZIMUTH}, got {len(azimuth)}")
    return BeamPattern(path.stem, np.radians(elevation), None if azimuth is None else np.radians(azimuth))


def _from_csv(path: Path) -> dict[str, list[float]]:
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidValueError(f"cannot read the beam table {path}: {error}") from error
    reader = csv.reader(text.splitlines())
    header = [cell.strip() for cell in next(reader, [])]
    if header not in ([ELEVATION], [ELEVATION, AZIMUTH], [AZIMUTH, ELEVATION]):
        raise InvalidValueError(
            f"{path}:1: a beam table has the columns {ELEVATION} and, if any, {AZIMUTH}, got {header}"
        )
    table: dict[str, list[float]] = {key: [] for key in header}
    for row in reader:
        at = f"{path}:{reader.line_num}"
        if row and len(row) != len(header):
            raise InvalidValueError(f"{at}: a beam has {len(header)} values, got {len(row)}")
        for key, cell in zip(header, row, strict=False):
            table[key].append(_degrees(at, key, cell.strip()))
    return table


def _degrees(at: str, key: str, cell: str) -> float:
    try:
        value = float(cell)
        _CHECKS[key](**{key: value})
    except InvalidValueError as error:
        raise InvalidValueError(f"{at}: {error}") from error
    except ValueError:
        raise InvalidValueError(f"{at}: {key} must be a number, got {cell!r}") from None
    return value


def _from_yaml(path: Path) -> dict[str, list[float]]:
    fields = read_yaml(path, InvalidValueError).fields([ELEVATION], [AZIMUTH])
    return {key: [float(item.checked(_CHECKS[key])) for item in entry.entries()] for key, entry in fields.items()}
