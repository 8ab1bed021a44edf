"""Flat triangles laid on a relief lie on it everywhere."""

import numpy as np

from coopsim.world.relief.draping import drape
from coopsim.world.relief.relief import Relief

ROOF = np.array(
    [
        [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [20.0, 4.0, 1.0]],
        [[0.0, 0.0, 0.0], [20.0, 4.0, 1.0], [0.0, 4.0, 1.0]],
        [[0.0, 4.0, 1.0], [20.0, 4.0, 1.0], [20.0, 8.0, 0.0]],
        [[0.0, 4.0, 1.0], [20.0, 8.0, 0.0], [0.0, 8.0, 0.0]],
    ]
)


def test_draped_triangles_are_as_high_as_the_ground() -> None:
    relief = Relief(ROOF)
    flat = np.array([[[2.0, 1.0], [9.0, 2.0], [5.0, 7.0]], [[15.0, -3.0], [30.0, 3.0], [18.0, 12.0]]])
    laid = drape(flat, relief.grid)
    places = np.random.default_rng(1).uniform([-2.0, -4.0], [32.0, 13.0], (3000, 2))
    covered = Relief(np.column_stack([flat.reshape(-1, 2), np.ones(6)])).heights(places) > 0
    assert 300 < covered.sum() < 2500
    np.testing.assert_allclose(Relief(laid).heights(places), np.where(covered, relief.heights(places), 0), atol=1e-9)
    assert (laid[:2, :, 2] == 0).all(), "the flat ones stay, for where nothing is raised"


def test_many_surfaces_below_one_triangle() -> None:
    tiles = [ROOF[:1] / [20, 4, 1] + [x, y, 0] for x in range(30) for y in range(30)]
    laid = drape(np.array([[[0.0, 0.0], [30.0, 0.0], [0.0, 30.0]]]), Relief(np.concatenate(tiles)).grid)
    assert len(laid) > 400
    assert drape(np.zeros((0, 3, 2)), Relief(ROOF).grid).shape == (0, 3, 3)
