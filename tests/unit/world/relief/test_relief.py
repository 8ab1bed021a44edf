"""Heights are those of the highest triangle over a place."""

import numpy as np
import pytest

from coopsim.geometry.se3 import SE3, Floats
from coopsim.world.places.relief import Relief, drape

SLOPE = np.array([[[0.0, 0.0, 0.0], [40.0, 0.0, 4.0], [40.0, 30.0, 4.0]], [[0, 0, 0], [40, 30, 4], [0, 30, 0]]])
STEP = np.array([[[10.0, 10.0, 2.0], [20.0, 10.0, 2.0], [10.0, 20.0, 2.0]]])


def test_the_highest_surface_counts_and_beside_all_it_is_flat() -> None:
    relief = Relief(np.concatenate([SLOPE, STEP]))
    places = np.array([[4.0, 3.0], [12.0, 12.0], [30.0, 12.0], [39.0, 29.0], [-1.0, 3.0], [50.0, 3.0], [4.0, 1e9]])
    np.testing.assert_allclose(relief.heights(places), [0.4, 2.0, 3.0, 3.9, 0.0, 0.0, 0.0], atol=1e-12)
    assert relief.raised(SE3.from_xyz_yaw([30.0, 12.0, 1.0], 0.3)).translation[2] == pytest.approx(4.0)


def test_there_is_no_gap_between_triangles_and_all_cells_are_searched() -> None:
    rng = np.random.default_rng(0)
    turn, far = SE3.from_xyz_yaw([812.0, -471.0, 0.0], 0.7), rng.uniform([0, 0], [40, 30], (4000, 2))
    diagonal = np.linspace(0, 1, 500)[:, None] * [40.0, 30.0]
    flat = np.concatenate([far, diagonal])
    places = turn.apply(np.column_stack([flat, np.zeros(len(flat))]))[:, :2]
    relief = Relief(turn.apply(SLOPE.reshape(-1, 3)))
    np.testing.assert_allclose(relief.heights(places), flat[:, 0] / 10, atol=1e-6)


def test_nothing_is_flat() -> None:
    assert Relief(np.zeros((0, 3, 3))).heights(np.array([[0.0, 0.0], [np.nan, 3.0]])).tolist() == [0.0, 0.0]


ROOF = np.array(
    [
        [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [20.0, 4.0, 1.0]],
        [[0.0, 0.0, 0.0], [20.0, 4.0, 1.0], [0.0, 4.0, 1.0]],
        [[0.0, 4.0, 1.0], [20.0, 4.0, 1.0], [20.0, 8.0, 0.0]],
        [[0.0, 4.0, 1.0], [20.0, 8.0, 0.0], [0.0, 8.0, 0.0]],
    ]
)


def _at(z_m: float, flat: Floats) -> Floats:
    """Return triangles (N, 3, 3) at a height over those in the plane (N, 3, 2)."""
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), z_m)], axis=2)


def test_what_is_over_the_ground_stays_as_far_over_it() -> None:
    flat, grid = np.array([[[2.0, 1.0], [9.0, 2.0], [5.0, 7.0]]]), Relief(ROOF).grid
    low, high = drape(_at(0.0, flat), grid), drape(_at(0.3, flat), grid)
    np.testing.assert_allclose(high - low, np.broadcast_to([0.0, 0.0, 0.3], low.shape), atol=1e-12)


def test_draped_triangles_are_as_high_as_the_ground() -> None:
    relief = Relief(ROOF)
    flat = np.array([[[2.0, 1.0], [9.0, 2.0], [5.0, 7.0]], [[15.0, -3.0], [30.0, 3.0], [18.0, 12.0]]])
    laid = drape(_at(0.0, flat), relief.grid)
    places = np.random.default_rng(1).uniform([-2.0, -4.0], [32.0, 13.0], (3000, 2))
    covered = Relief(np.column_stack([flat.reshape(-1, 2), np.ones(6)])).heights(places) > 0
    assert 300 < covered.sum() < 2500
    np.testing.assert_allclose(Relief(laid).heights(places), np.where(covered, relief.heights(places), 0), atol=1e-9)
    assert (laid[:2, :, 2] == 0).all(), "the flat ones stay, for where nothing is raised"


def test_many_surfaces_below_one_triangle() -> None:
    tiles = [ROOF[:1] / [20, 4, 1] + [x, y, 0] for x in range(30) for y in range(30)]
    laid = drape(_at(0.0, np.array([[[0.0, 0.0], [30.0, 0.0], [0.0, 30.0]]])), Relief(np.concatenate(tiles)).grid)
    assert len(laid) > 400
    assert drape(np.zeros((0, 3, 3)), Relief(ROOF).grid).shape == (0, 3, 3)
