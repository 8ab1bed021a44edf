"""A hump is a smooth wave on the road, crowned or not."""

import numpy as np

from coopsim.world.relief.humps import Hump
from coopsim.world.relief.relief import Relief

FLAT = Relief(np.zeros((0, 3, 3)))


def test_the_profile_is_a_wave() -> None:
    hump = Hump(100.0, 50.0, np.pi / 2, 7.0, 3.7, 0.1)
    ground = Relief(hump.triangles(FLAT))
    along = np.linspace(-1.85, 1.85, 101)
    for aside in (-2.9, 0.3, 2.9):
        heights = ground.heights(np.column_stack([np.full(101, 100.0 - aside), 50.0 + along]))
        np.testing.assert_allclose(heights, 0.05 * (1 + np.cos(2 * np.pi * along / 3.7)), atol=2e-3)
    assert ground.heights(np.array([[103.49, 50.0], [103.51, 50.0], [100.0, 51.9]])).max() < 0.01


def test_on_a_slope_it_adds_to_the_road() -> None:
    road = Relief(
        np.array([[[0.0, -9.0, 0.0], [9.0, -9.0, 0.9], [9.0, 9.0, 0.9]], [[0, -9, 0], [9, 9, 0.9], [0, 9, 0]]])
    )
    hump = Hump(4.0, 0.0, 0.0, 6.0, 4.0, 0.1)
    both = np.concatenate([road.grid.triangles, hump.triangles(road)])
    assert abs(Relief(both).heights(np.array([[4.0, 1.0]]))[0] - 0.5) < 1e-9
