"""Grids, and feature maps that are moved from one to another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.types import BevGrid, FeatureMap, PointCloud, Sweep

GRID = BevGrid((-8.0, 8.0), (-4.0, 4.0), 0.5)


def plane(grid: BevGrid, gradient: tuple[float, float] = (0.3, -0.2)) -> FeatureMap:
    """One channel that rises evenly in x and y: what bilinear interpolation must keep."""
    values = grid.cell_centers() @ np.array(gradient)
    return FeatureMap(values[None], grid, np.full(grid.shape, 0.5))


def pose(x: float, y: float, yaw: float, z: float = 0.0) -> SE3:
    return SE3.from_xyz_yaw([x, y, z], yaw)


def test_columns_go_along_x_and_rows_along_y() -> None:
    assert GRID.shape == (16, 32)
    centers = GRID.cell_centers()
    np.testing.assert_allclose(centers[0, 0], [-7.75, -3.75])
    np.testing.assert_allclose(centers[0, 1] - centers[0, 0], [0.5, 0])
    np.testing.assert_allclose(centers[1, 0] - centers[0, 0], [0, 0.5])
    np.testing.assert_allclose(centers[-1, -1], [7.75, 3.75])


def test_a_coarser_grid_covers_the_same_area() -> None:
    coarse = GRID.coarser(4)
    assert (coarse.x_m, coarse.y_m, coarse.cell_m, coarse.shape) == (GRID.x_m, GRID.y_m, 2.0, (4, 8))
    np.testing.assert_allclose(coarse.cell_centers()[0, 0], GRID.cell_centers()[:4, :4].mean(axis=(0, 1)))
    with pytest.raises(InvalidValueError, match=r"factor must divide \(16, 32\) cells, got 3"):
        GRID.coarser(3)


@pytest.mark.parametrize("cell_m", [0.1, 0.3, 0.4, 0.7])
def test_sizes_that_binary_fractions_only_approach_are_whole_numbers_of_cells(cell_m: float) -> None:
    assert BevGrid((-100 * cell_m, 256 * cell_m), (0, 3 * cell_m), cell_m).shape == (3, 356)


@pytest.mark.parametrize(
    ("given", "match"),
    [
        (((0, 1), (0, 1), 0.0), "cell_m must be a finite number > 0"),
        (((0, 1), (0, 1), 0.3), "x_m must be a whole number >= 1 of cells of 0.3 m, got 0 to 1"),
        (((0, 1), (1, 0), 0.5), "y_m must be a whole number >= 1 of cells"),
        (((0, 1), (1, 1), 0.5), "y_m must be a whole number"),
        (((0, np.inf), (0, 1), 0.5), r"x_m\[1\] must be a finite number"),
        ((3, (0, 1), 0.5), "x_m must be the least and the largest value, got 3"),
    ],
)
def test_what_is_no_grid_is_refused(given: Any, match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        BevGrid(*given)


def test_a_map_has_the_shape_of_its_grid() -> None:
    with pytest.raises(InvalidValueError, match=r"values must have shape \(N, 16, 32\), got \(2, 32, 16\)"):
        FeatureMap(np.zeros((2, 32, 16)), GRID)
    with pytest.raises(InvalidValueError, match="grid must be a BevGrid"):
        FeatureMap(np.zeros((2, 16, 32)), (16, 32))  # type: ignore[arg-type]
    with pytest.raises(
        InvalidValueError, match=r"request must be of square blocks of \(16, 32\) cells, got .* \(4, 4\)"
    ):
        FeatureMap(np.zeros((2, 16, 32)), GRID, request=np.zeros((4, 4)))
    with pytest.raises(InvalidValueError, match=r"space must be .*, got -1"):
        FeatureMap(np.zeros((2, 16, 32)), GRID, space=-1)
    with pytest.raises(InvalidValueError, match=r"features must be on the grid x -8 to 8 m, .* warp them"):
        plane(GRID.coarser(2)).require_grid(GRID)
    plane(GRID).require_grid(GRID)


def test_not_moved_is_not_changed() -> None:
    """The identity law: to the bit, whatever the grid's numbers are."""
    rng = np.random.default_rng(0)
    for grid in (GRID, BevGrid((-51.2, 51.2), (-38.4, 38.4), 0.4), BevGrid((0.1, 0.8), (0.7, 2.1), 0.7)):
        sent = FeatureMap(rng.normal(size=(3, *grid.shape)), grid, rng.random(grid.shape))
        got, mask = sent.warp(grid, SE3.identity())
        assert mask.all() and got.confidence is not None and sent.confidence is not None
        np.testing.assert_array_equal(got.values, sent.values)
        np.testing.assert_array_equal(got.confidence, sent.confidence)


@settings(max_examples=40)
@given(
    x=st.floats(-20, 20), y=st.floats(-20, 20), z=st.floats(-3, 3), yaw=st.floats(-4, 4), factor=st.sampled_from([1, 2])
)
def test_an_even_slope_stays_where_it_is_in_the_world(x: float, y: float, z: float, yaw: float, factor: int) -> None:
    dst_SE3_src = pose(x, y, yaw, z)
    grid = GRID.coarser(factor)
    got, mask = plane(GRID).warp(grid, dst_SE3_src)
    centers = np.concatenate([grid.cell_centers(), np.full((*grid.shape, 1), z)], axis=-1)
    there = dst_SE3_src.inverse().apply(centers)[..., :2]
    inside = (np.abs(there) <= [7.75 + 1e-9, 3.75 + 1e-9]).all(axis=-1)
    clear = (np.abs(np.abs(there) - [7.75, 3.75]) > 1e-5).all(axis=-1)  # elsewhere rounding decides
    np.testing.assert_array_equal(mask[clear], inside[clear])
    np.testing.assert_allclose(got.values[0][mask], (there @ np.array([0.3, -0.2]))[mask], atol=1e-4)
    assert not got.values[0][~mask].any() and got.confidence is not None
    np.testing.assert_allclose(got.confidence, 0.5 * mask, atol=1e-6)


def test_features_without_confidence_stay_so() -> None:
    assert FeatureMap(np.ones((1, *GRID.shape)), GRID).warp(GRID, pose(1, 0, 0))[0].confidence is None


def test_clouds_are_joined_and_moved() -> None:
    sweep = Sweep(np.array([[1.0, 0, 0]]), np.array([0.5]), np.zeros(1, dtype=int))
    cloud = PointCloud.of(sweep, sweep)
    assert len(cloud) == 2 and len(PointCloud.of()) == 0
    np.testing.assert_allclose(cloud.transform(pose(0, 2, np.pi / 2)).xyz, [[0, 3, 0]] * 2, atol=1e-6)
