import numpy as np
import pytest
from shapely import Polygon

from coopsim.world.towns.beside.pieces import convex_pieces


def areas(surfaces):
    corners, count = convex_pieces(np.array(surfaces, dtype=float))
    outlines = [Polygon(each[:number]) for each, number in zip(corners, count, strict=True)]
    assert all(outline.convex_hull.area == pytest.approx(outline.area) for outline in outlines)
    return [outline.area for outline in outlines]


def test_convex_surface_stays_whole():
    assert areas([[[0, 0], [2, 0], [2, 1], [0, 1]]]) == pytest.approx([2])


def test_dented_surface_is_cut():
    assert sum(areas([[[0, 0], [4, 0], [1, 1], [0, 4]]])) == pytest.approx(4)


@pytest.mark.parametrize("corners", [[[0, 0], [2, 0], [2, 0], [0, 0]], [[0, 0], [1, 0], [2, 0], [3, 0.001]]])
def test_slits_are_left_out(corners):
    assert areas([corners]) == []


def test_double_corner_is_left_out():
    assert areas([[[0, 0], [2, 0], [2, 0], [0, 1]]]) == pytest.approx([1])
