"""Rays of a sweep: those of its points, and those that did not come back, by the sensor's own beams.

Neither rings nor the sensor's place need be known. Seen from the right place, the points of a spinning LiDAR lie at few
elevations, its rings; from a wrong one they smear. In a ring, points follow at equal angles, so a gap tells how many
rays are missing there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

_BAND_M = (3.0, 60.0)  # ground distances of points that tell the sensor's place: nearer ones are of the own car
_POINTS = 30_000  # of the band that are looked at
_BIN_RAD = np.radians(0.03)
_STEPS, _LEAST_STEP = np.array([0.4, 0.4, 0.2, 0.01, 0.01]), 0.01  # m and slopes; share of the steps at the end
_MOST_AWAY_M, _HEIGHTS_M = 4.0, (0.3, 12.0)
_ROW_BIN_RAD, _ROW_BLUR, _ROW_PROMINENCE = np.radians(0.02), 2.5, 0.15
_WIDEST_STEP_RAD = np.radians(2.0)
_DROPPED_RAD, _DROPPED = np.radians(1.5), 3  # gaps that are wider, and of more rays, look into the open
_SECTOR_RAD = np.radians(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class SweepRays:
    """R rays of a sweep of N points in the base frame; those of the points are first, in their order.

    Attributes:
        origin_m: (3,) place of the sensor.
        directions: (R, 3) unit vectors.
        range_m: (R,) distance up to which the ray is known to be free; inf: it met nothing.
    """

    origin_m: Floats
    directions: Floats
    range_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class SensorPose:
    """Place (3,) m of a sensor in the base frame, and slopes (2,) of its plane of elevation 0 along x and y."""

    origin_m: Floats
    slopes: Floats


def find_sensor(points: Floats, guess_m: Floats) -> SensorPose:
    """Find the sensor of points (N, 3) near a guess (3,): the place from which they lie in the sharpest rings.

    At most 4 m to the sides of the guess, and 0.3 to 12 m over the ground.
    """
    away_m = np.hypot(points[:, 0] - guess_m[0], points[:, 1] - guess_m[1])
    band = points[(away_m > _BAND_M[0]) & (away_m < _BAND_M[1])]
    band = band[:: max(1, len(band) // _POINTS)]
    best, step = np.concatenate([guess_m, np.zeros(2)]), _STEPS.copy()
    sharpest = _sharpness(band, best)
    while len(band) and (step > _STEPS * _LEAST_STEP).all():
        tried = best + np.concatenate([np.diag(step), -np.diag(step)])
        tried = tried[(np.abs(tried[:, :2] - guess_m[:2]) <= _MOST_AWAY_M).all(axis=1)]
        tried = tried[(tried[:, 2] > _HEIGHTS_M[0]) & (tried[:, 2] < _HEIGHTS_M[1])]
        values = np.array([_sharpness(band, each) for each in tried])
        if values.max(initial=0.0) > sharpest * 1.0001:
            best, sharpest = tried[values.argmax()], values.max()
        else:
            step /= 2
    return SensorPose(best[:3], best[3:])


def _sharpness(points: Floats, sensor: Floats) -> float:
    """Return the mean number of points (N, 3) at the elevation of a point, seen by a sensor (5,): place and slopes."""
    _, elevation, _ = _angles(points, SensorPose(sensor[:3], sensor[3:]))
    counts = np.bincount(np.floor((elevation + np.pi / 2) / _BIN_RAD).astype(np.int64).clip(0))
    return float((counts.astype(np.float64) ** 2).sum() / max(len(points), 1))


def _angles(points: Floats, sensor: SensorPose) -> tuple[Floats, Floats, Floats]:
    """Return azimuth, elevation over the sensor's plane, and range, (N,) each, of points (N, 3)."""
    away = points - sensor.origin_m
    azimuth = np.arctan2(away[:, 1], away[:, 0])
    along = np.hypot(away[:, 0], away[:, 1])
    tilt = sensor.slopes[0] * np.cos(azimuth) + sensor.slopes[1] * np.sin(azimuth)
    return azimuth, np.arctan2(away[:, 2], along) - tilt, np.hypot(along, away[:, 2])


def find_rows(elevation: Floats) -> Floats:
    """Return the elevations (B,) rad of rings, which rise, of points at elevations (N,).

    Rings that are closer than about 0.1 degrees are one row, which then has the points of both.
    """
    counts = np.bincount(
        np.floor((elevation + np.pi / 2) / _ROW_BIN_RAD).astype(np.int64), minlength=round(np.pi / _ROW_BIN_RAD) + 1
    )
    smooth = gaussian_filter1d(counts.astype(np.float64), _ROW_BLUR)
    usual = float(np.median(smooth[smooth > 0])) if len(elevation) else 0.0
    peaks, _ = find_peaks(smooth, prominence=_ROW_PROMINENCE * usual, distance=4)
    rows: Floats = (peaks + 0.5) * _ROW_BIN_RAD - np.pi / 2
    return rows


def rays_of(points: Floats, sensor: SensorPose) -> SweepRays:
    """Return the rays of points (N, 3), and those that are missing between them."""
    azimuth, elevation, range_m = _angles(points, sensor)
    away = points - sensor.origin_m
    toward = away / np.maximum(range_m, 1e-6)[:, None]
    rows = find_rows(elevation)
    if not len(rows):
        return SweepRays(sensor.origin_m, toward, range_m)
    row = np.searchsorted((rows[1:] + rows[:-1]) / 2, elevation)
    missing, its_row, its_range = _missing(azimuth, row, range_m)
    its_elevation = rows[its_row] + sensor.slopes[0] * np.cos(missing) + sensor.slopes[1] * np.sin(missing)
    flat = np.cos(its_elevation)
    further = np.column_stack([flat * np.cos(missing), flat * np.sin(missing), np.sin(its_elevation)])
    return SweepRays(sensor.origin_m, np.concatenate([toward, further]), np.concatenate([range_m, its_range]))


def _missing(azimuth: Floats, row: Ints, range_m: Floats) -> tuple[Floats, Ints, Floats]:
    """Return azimuth, row and free range, (M,) each, of the rays that are missing in the gaps of rows.

    A narrow gap is free up to the nearer of its ends: what is there may have swallowed the light. No ray is missing in
    directions from which no row has a point: the sweep is cut there.
    """
    order = np.lexsort((azimuth, row))
    azimuth, row, range_m = azimuth[order], row[order], range_m[order]
    last = np.append(np.flatnonzero(np.diff(row)), len(row) - 1)
    after = np.arange(1, len(row) + 1)
    after[last] = np.append(0, last[:-1] + 1)
    gap = (azimuth[after] - azimuth) % (2 * np.pi)
    step = _steps(gap, row)[row]
    count = np.maximum(np.rint(gap / step).astype(np.int64) - 1, 0)
    start = np.repeat(np.arange(len(row)), count)
    nth = np.arange(len(start)) - np.repeat(np.cumsum(count) - count, count) + 1
    found = azimuth[start] + nth * gap[start] / (count[start] + 1)
    free_m = np.where((gap < _DROPPED_RAD) | (count <= _DROPPED), np.minimum(range_m, range_m[after]), np.inf)[start]
    seen = np.zeros(round(2 * np.pi / _SECTOR_RAD), np.bool_)
    seen[_sector(azimuth, len(seen))] = True
    kept = seen[_sector(found, len(seen))]
    return found[kept], row[start][kept], free_m[kept]


def _sector(azimuth: Floats, count: int) -> Ints:
    return np.floor((azimuth % (2 * np.pi)) / (2 * np.pi) * count).astype(np.int64) % count


def _steps(gap: Floats, row: Ints) -> Floats:
    """Return the usual angle (B,) between neighbours of each row; of rows with many losses that of all rows."""
    near = gap < _WIDEST_STEP_RAD
    usual = float(np.median(gap[near])) if near.any() else _WIDEST_STEP_RAD
    steps = np.full(row.max() + 1, usual)
    for each in np.unique(row[near]):
        steps[each] = min(usual, float(np.median(gap[near & (row == each)])))
    return np.maximum(steps, usual / 4)
