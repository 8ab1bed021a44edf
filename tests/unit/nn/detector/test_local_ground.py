"""Local ground: exact on slopes and hills, behind cars, without points, and blind to reflections and things."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from coopsim.geometry.se3 import Floats
from coopsim.nn.detector.local_ground import local_ground
from coopsim.nn.detector.pillars import GroundSettings, PillarSettings, pillarize
from coopsim.types import BevGrid

Shape = Callable[[Floats, Floats], Floats]
SHAPES: dict[str, Shape] = {
    "flat": lambda x, y: 0 * x,
    "8 % ahead": lambda x, y: 0.08 * x,
    "8 % aslant": lambda x, y: 0.0566 * (x + y),
    "12 % aside": lambda x, y: 0.12 * y,
    "hills of 8 %": lambda x, y: 1.27 * np.sin(2 * np.pi * x / 100),
    "a ramp from 8 m on": lambda x, y: 0.08 * np.maximum(x - 8, 0),
}


def street(shape: Shape) -> tuple[np.ndarray, Floats]:
    """Return points (P, 5) of a street, with cars that hide the ground, walls and reflections; and its ground (P,)."""
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-60, 60, (20_000, 2)), rng.normal(0, 0.02, 20_000)])
    ground = ground[rng.random(20_000) < np.clip(10 / np.hypot(*ground[:, :2].T), 0, 1) ** 1.5]
    cars = np.arange(-50, 50, 5.5)
    behind = np.abs(np.abs(ground[:, 1]) - 9) < 4  # a car and what it hides
    hidden = behind & (np.abs(ground[:, :1] - cars).min(axis=1) < 2.2)
    sides = np.column_stack([rng.uniform(-2.2, 2.2, 3000), rng.uniform(-0.9, 0.9, 3000), rng.uniform(0.3, 1.5, 3000)])
    sides[:, :2] += np.column_stack([rng.choice(cars, 3000), rng.choice([-6.0, 6.0], 3000)])
    walls = np.column_stack([rng.uniform(-60, 60, 4000), rng.choice([-30.0, 30.0], 4000), rng.uniform(0, 6, 4000)])
    below = np.column_stack([rng.uniform(-40, 40, (6, 2)), rng.uniform(-4, -2, 6)])
    points = np.concatenate([ground[~hidden], sides, walls, below])
    under = shape(points[:, 0], points[:, 1])
    points[:, 2] += under
    return np.column_stack([points, np.full(len(points), 0.5), np.zeros(len(points))]).astype(np.float32), under


@pytest.mark.parametrize("name", SHAPES)
def test_heights_over_the_ground_are_right_whatever_its_shape(name: str) -> None:
    points, under = street(SHAPES[name])
    near = np.abs(points[:, :2]).max(axis=1) < 40
    away = np.abs(local_ground(points) - under)[near]
    assert away.max() < 0.2
    assert np.percentile(away, 98) < 0.15
    assert away.mean() < 0.04


def test_where_nothing_is_seen_the_ground_goes_on_from_the_agent_s() -> None:
    assert len(local_ground(np.zeros((0, 5), np.float32))) == 0
    roof = np.float32([[20.0, 5.0, 3.0, 0.5, 0], [21.0, 5.0, 3.0, 0.5, 0]])
    assert np.abs(local_ground(roof)).max() < 0.01
    points, _ = street(SHAPES["8 % ahead"])
    near = points[points[:, 0] < 30]
    beyond = np.concatenate([near, np.float32([[40.0, 0.0, 6.0, 0.5, 0]])])
    assert 2.4 < local_ground(beyond)[-1] < 3.6  # 3.2 m if the slope goes on


def test_the_order_of_points_and_the_heading_do_not_matter() -> None:
    points, _ = street(SHAPES["hills of 8 %"])
    order = np.random.default_rng(1).permutation(len(points))
    np.testing.assert_array_equal(local_ground(points)[order], local_ground(points[order]))
    turned = points[:, [1, 0, 2, 3, 4]] * np.float32([-1, 1, 1, 1, 1])
    np.testing.assert_allclose(local_ground(turned), local_ground(points), atol=0.1)


def test_pillars_on_it_hold_what_stands_on_a_slope_with_its_height() -> None:
    points, under = street(SHAPES["8 % ahead"])
    person = np.float32([[30.0, 2.0, 0.08 * 30 + z, 0.5, 0] for z in (0.3, 0.8, 1.3, 1.7)])
    grid = BevGrid((-48.0, 48.0), (-24.0, 24.0), 0.4)
    found = pillarize(np.concatenate([points, person]), grid, PillarSettings(GroundSettings(local=True)))
    row, column = int((2.0 + 24) / 0.4), int((30.0 + 48) / 0.4)
    (where,) = np.flatnonzero(found.cell == row * 240 + column)
    start = found.count[:where].sum()
    heights = np.sort(found.features[start : start + found.count[where], 6] * 2)
    np.testing.assert_allclose(heights[-4:], [0.3, 0.8, 1.3, 1.7], atol=0.1)
    on_ground = (points[:, 2] - under < 0.1) & (np.abs(points[:, 0]) < 48) & (np.abs(points[:, 1]) < 24)
    kept = found.features[:, 6] * 2 < 0.25
    assert np.count_nonzero(kept) < 0.01 * np.count_nonzero(on_ground)
