"""Pillars: order and number of points, ground, borders."""

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.nn.detector.pillars import GroundSettings, PillarSettings, collate, pillarize
from coopsim.types import BevGrid

GRID = BevGrid((-9.6, 9.6), (-4.8, 4.8), 0.6)


def cloud(count: int = 500, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.uniform([-12, -6, 0.4, 0, 0], [12, 6, 3, 1, 0.1], (count, 5))
    return points.astype(np.float32)


def rows(pillars) -> np.ndarray:
    """Return the points' features with their cells, sorted."""
    table = np.column_stack([np.repeat(pillars.cell, pillars.count), pillars.features])
    return table[np.lexsort(table.T[::-1])]


def test_the_order_of_points_does_not_matter() -> None:
    points = cloud()
    shuffled = points[np.random.default_rng(1).permutation(len(points))]
    np.testing.assert_allclose(rows(pillarize(points, GRID)), rows(pillarize(shuffled, GRID)), atol=1e-5)


def test_a_pillar_takes_any_number_of_points() -> None:
    points = np.tile(np.float32([[0.1, 0.1, 1.0, 0.5, 0.0]]), (5000, 1))
    pillars = pillarize(points, GRID)
    assert pillars.count.tolist() == [5000]
    assert len(pillars.features) == 5000


def test_points_on_the_lower_edge_are_inside_and_those_on_the_upper_edge_outside() -> None:
    grid = BevGrid((-8.0, 8.0), (-4.0, 4.0), 0.5)
    points = np.float32([[-8, -4, 1, 0, 0], [8, 0, 1, 0, 0], [0, 4, 1, 0, 0], [7.99, 3.99, 1, 0, 0]])
    pillars = pillarize(points, grid)
    assert pillars.cell.tolist() == [0, 16 * 32 - 1]


@pytest.mark.parametrize("count", [0, 1])
def test_few_points(count: int) -> None:
    pillars = pillarize(cloud()[100 : 100 + count], GRID)
    assert len(pillars.features) <= count
    assert pillars.shape == (16, 32)


def test_ground_is_dropped_also_where_it_is_a_little_higher() -> None:
    ground = np.float32([[x / 2, y / 2, 0.12, 0.3, 0] for x in range(-8, 8) for y in range(-8, 8)])
    post = np.float32([[1.0, 1.0, z, 0.5, 0] for z in (0.2, 0.5, 1.0, 1.5)])
    pillars = pillarize(np.concatenate([ground, post]), GRID)
    assert pillars.count.tolist() == [3]  # the lowest point of the post is no more than 0.15 m above the ground
    np.testing.assert_allclose(pillars.features[:, 6] * 2, [0.38, 0.88, 1.38], atol=1e-5)


def test_a_thing_without_ground_beside_it_keeps_its_height() -> None:
    car = np.float32([[5, 0, z, 0.5, 0] for z in (0.6, 0.9, 1.2)])
    heights = pillarize(car, GRID).features[:, 6] * 2
    assert (heights > 0.3).all()  # the ground under it is at most 0.25 m up, whatever is seen of it


def test_hills_need_a_larger_relief() -> None:
    hill = np.float32([[x / 2, y / 2, 2.0, 0.3, 0] for x in range(-8, 8) for y in range(-8, 8)])
    assert len(pillarize(hill, GRID).features) == len(hill)
    assert len(pillarize(hill, GRID, PillarSettings(GroundSettings(relief_m=5.0))).features) == 0


def test_no_feature_tells_where_in_the_grid_a_pillar_is() -> None:
    points = cloud()
    points = points[(np.abs(points[:, 0]) < 3) & (np.abs(points[:, 1]) < 2)]
    moved = points + np.float32([4.8, 2.4, 0, 0, 0])
    np.testing.assert_allclose(
        np.sort(pillarize(points, GRID).features, axis=0), np.sort(pillarize(moved, GRID).features, axis=0), atol=1e-4
    )


def test_a_batch_numbers_cells_through_all_clouds() -> None:
    batch = collate([pillarize(cloud(seed=k), GRID) for k in range(3)])
    assert batch.clouds == 3
    assert int(batch.count.sum()) == len(batch.features)
    assert int(batch.cell.max()) >= 2 * 16 * 32


def test_bad_points_and_batches_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="finite"):
        pillarize(np.full((3, 5), np.nan, np.float32), GRID)
    with pytest.raises(InvalidValueError, match=r"\(P, 5\)"):
        pillarize(np.zeros((3, 4), np.float32), GRID)
    with pytest.raises(InvalidValueError, match="one shape"):
        collate([pillarize(cloud(), GRID), pillarize(cloud(), BevGrid((-9.6, 9.6), (-9.6, 9.6), 0.6))])
    with pytest.raises(InvalidValueError, match="no cloud"):
        collate([])
