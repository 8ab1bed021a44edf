"""Boxes around outlines are the smallest rectangles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import MultiPoint

from coopsim.world.custom.scenery import box_around

POINTS = st.lists(st.tuples(st.integers(-40, 40), st.integers(-40, 40)), min_size=4, max_size=9)


@given(POINTS)
def test_the_box_is_the_smallest_rectangle_and_holds_all_corners(points: list[tuple[int, int]]) -> None:
    hull = MultiPoint(points).convex_hull
    if hull.area < 1.0:
        return
    outline = np.array(hull.exterior.coords)[:-1][::-1]
    x, y, z, length, width, height, yaw = box_around(outline, 1.0, 5.0)
    assert (z, height) == (3.0, 4.0)
    assert length * width == pytest.approx(hull.minimum_rotated_rectangle.area)
    offset = outline - [x, y]
    along, aside = offset @ [np.cos(yaw), np.sin(yaw)], offset @ [-np.sin(yaw), np.cos(yaw)]
    assert np.abs(along).max() == pytest.approx(length / 2) and np.abs(aside).max() == pytest.approx(width / 2)
