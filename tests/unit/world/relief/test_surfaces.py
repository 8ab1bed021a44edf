"""A crown rises to the middle, is level at its ends and edges, and cut only where the slope changes."""

import numpy as np
import pytest

from coopsim.world.models.surfaces import wet_albedo
from coopsim.world.places.relief import Relief
from coopsim.world.relief.surfaces import Hump, crown_triangles

STREET = np.array([[0.0, 0.0], [40.0, 0.0], [100.0, 0.0]])


def test_heights_are_those_of_a_hipped_roof() -> None:
    triangles = crown_triangles(STREET, 4.0, 0.025)
    x, y = np.random.default_rng(2).uniform([0.0, -4.0], [100.0, 4.0], (2000, 2)).T
    roof = np.minimum(0.025 * (4 - np.abs(y)), 0.1 * np.minimum(x, 100 - x) / 8)
    np.testing.assert_allclose(Relief(triangles).heights(np.column_stack([x, y])), roof, atol=1e-9)
    assert len(triangles) == 12
    assert (np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2] >= 0).all()


def test_short_roads_have_none() -> None:
    assert len(crown_triangles(STREET[:2] / 4, 4.0, 0.025)) == 0


def test_a_bent_road_is_as_high_in_its_middle_all_along() -> None:
    angle = np.linspace(0, np.pi / 2, 30)
    bend = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    ground = Relief(crown_triangles(bend, 4.0, 0.02))
    for radius, height in ((30.0, 0.08), (32.0, 0.04), (28.0, 0.04), (26.01, 0.0), (33.99, 0.0)):
        middle = radius * np.column_stack([np.cos(angle[8:-8]), np.sin(angle[8:-8])])
        assert ground.heights(middle) == pytest.approx(np.full(14, height), abs=2e-3)


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


def test_a_film_of_water_darkens_by_angstroms_law() -> None:
    assert wet_albedo(np.array([0.3])) == pytest.approx(0.3 / (1.33**2 * 0.7 + 0.3))
    assert wet_albedo(np.array([0.0, 1.0])) == pytest.approx([0.0, 1.0])
