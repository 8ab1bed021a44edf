"""Sensor, rings and missing rays of sweeps, against the LiDAR that made them."""

from __future__ import annotations

import numpy as np
import pytest
from bare_sweeps import COLUMNS, ORIGIN_M, bare_sweep
from sensor_scenes import box_part

from coopsim.learn.paste.rays import SensorPose, find_rows, find_sensor, rays_of
from coopsim.sensors.lidar.patterns import find_pattern

SENSOR = SensorPose(ORIGIN_M, np.zeros(2))


@pytest.fixture(scope="module")
def walled() -> np.ndarray:
    """Points in a yard: nearly all rays return."""
    walls = [
        box_part([x, y, 10], size)
        for x, y, size in ((-20, 0, (1, 60, 20)), (0, 20, (60, 1, 20)), (0, -20, (60, 1, 20)))
    ]
    return bare_sweep(*walls)[:, :3].astype(np.float64)


def test_the_place_of_the_sensor_is_found_from_a_guess_half_a_metre_away(walled: np.ndarray) -> None:
    found = find_sensor(walled, np.array([0.7, 0.3, 1.5]))
    np.testing.assert_allclose(found.origin_m, ORIGIN_M, atol=0.05)
    assert np.abs(found.slopes).max() < 0.004


def test_rings_are_the_beams_of_the_sensor(walled: np.ndarray) -> None:
    away = walled - ORIGIN_M
    rows = find_rows(np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1])))
    np.testing.assert_allclose(np.degrees(rows), np.sort(np.degrees(find_pattern("HDL-32E").elevation_rad)), atol=0.1)


def azimuth_of(points: np.ndarray) -> np.ndarray:
    return np.arctan2(points[:, 1], points[:, 0])


def test_points_are_the_first_rays_and_all_rays_are_those_of_the_sensor(walled: np.ndarray) -> None:
    """A tenth of the points is lost at random, and the upper rings look into the open in a sector of 11 degrees."""
    away = walled - ORIGIN_M
    open_sky = (np.abs(azimuth_of(away) - 1.0) < 0.1) & (away[:, 2] > 0)
    left = walled[~open_sky & (np.random.default_rng(0).random(len(walled)) > 0.1)]
    rays = rays_of(left, SENSOR)
    there = rays.origin_m + rays.directions * rays.range_m[:, None]
    np.testing.assert_allclose(there[: len(left)], left, atol=1e-6)
    assert len(rays.directions) == pytest.approx(32 * COLUMNS, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0)


def test_a_wide_gap_is_open_and_a_narrow_one_is_free_up_to_its_nearer_end(walled: np.ndarray) -> None:
    away = walled - ORIGIN_M
    azimuth, up = azimuth_of(away), away[:, 2] > 0
    wide, narrow = up & (np.abs(azimuth - 1.0) < 0.1), up & (np.abs(azimuth + 1.0) < 0.01)
    kept = ~wide & ~narrow
    rays = rays_of(walled[kept], SENSOR)
    its_azimuth, free_m = azimuth_of(rays.directions[kept.sum() :]), rays.range_m[kept.sum() :]
    in_wide, in_narrow = np.abs(its_azimuth - 1.0) < 0.09, np.abs(its_azimuth + 1.0) < 0.02
    assert in_wide.sum() >= 8 * 9 and np.isinf(free_m[in_wide]).all()
    near = np.linalg.norm(away[up & ~narrow & (np.abs(azimuth + 1.0) < 0.03)], axis=1)
    assert in_narrow.sum() >= 8 and near.min() <= free_m[in_narrow].min() and free_m[in_narrow].max() <= near.max()


def test_no_ray_is_missing_where_a_sweep_is_cut(walled: np.ndarray) -> None:
    front = walled[walled[:, 0] > ORIGIN_M[0]]
    rays = rays_of(front, SENSOR)
    assert len(rays.directions) < 1.03 * len(front) and rays.directions[:, 0].min() > -0.05


def test_a_sweep_without_points_has_no_rays() -> None:
    none = np.zeros((0, 3))
    assert len(rays_of(none, find_sensor(none, ORIGIN_M)).directions) == 0
