"""The ground's surface: exactly none in flat places, and close to slopes, also with things and reflections about."""

from __future__ import annotations

import numpy as np

from coopsim.nn.detector.ground import surface
from coopsim.nn.detector.pillars import pillarize
from coopsim.types import BevGrid

GRADE = 0.04


def street(grade: float) -> np.ndarray:
    """Return points (P, 5) of ground that rises along x, walls beside it, and some reflections far below."""
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-60, 60, (20_000, 2)), rng.normal(0, 0.02, 20_000)])
    walls = np.column_stack([rng.uniform(-60, 60, 4000), rng.choice([-30.0, 30.0], 4000), rng.uniform(0, 6, 4000)])
    below = np.column_stack([rng.uniform(-40, 40, (6, 2)), rng.uniform(-4, -2, 6)])
    points = np.concatenate([ground, walls, below])
    points[:, 2] += grade * points[:, 0]
    return np.column_stack([points, np.full(len(points), 0.5), np.zeros(len(points))]).astype(np.float32)


def test_a_flat_place_has_no_surface() -> None:
    assert not surface(street(0.0)).any()
    assert len(surface(np.zeros((0, 5), np.float32))) == 0


def test_a_slope_is_followed() -> None:
    points = street(GRADE)
    away = surface(points) - GRADE * points[:, 0]
    near = np.abs(points[:, :2]).max(axis=1) < 40
    assert np.abs(away[near]).mean() < 0.1
    assert np.percentile(np.abs(away[near]), 95) < 0.25


def test_points_on_a_slope_are_dropped_and_a_car_far_down_stays() -> None:
    car = np.float32([[-35.0 + dx, dy, 1.0 - GRADE * 35, 0.5, 0] for dx in (-1, 0, 1) for dy in (-0.5, 0.5)])
    grid = BevGrid((-48.0, 48.0), (-24.0, 24.0), 0.4)
    pillars = pillarize(np.concatenate([street(GRADE), car]), grid)
    assert len(pillars.features) < 0.1 * 16_000
    rows, columns = np.divmod(pillars.cell, pillars.shape[1])
    found = np.column_stack([columns, rows]) * 0.4 + [-47.8, -23.8]
    for x, y in car[:, :2]:
        assert (np.abs(found - [x, y]).max(axis=1) < 0.25).any()
