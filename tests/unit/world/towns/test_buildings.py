from itertools import combinations

import numpy as np
import pytest
from shapely import Polygon

from coopsim.world.towns import buildings as shapes

SHAPES = [
    shapes.plain,
    shapes.cut,
    shapes.with_bay,
    shapes.l_shape,
    shapes.u_shape,
    shapes.around_courtyard,
    shapes.terrace,
    shapes.with_annex,
    shapes.many_sided,
    shapes.church,
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.__name__)
def test_parts_are_convex_and_apart_and_within_the_lot(shape):
    for seed in range(20):
        width_m, depth_m = np.random.default_rng(seed).uniform([10, 20], [15, 30])
        parts = shape(width_m, depth_m, np.random.default_rng(seed))
        outlines = [Polygon(part.outline) for part in parts]
        for part, outline in zip(parts, outlines, strict=True):
            assert outline.is_valid
            assert outline.convex_hull.area == pytest.approx(outline.area)
            assert 0 < part.height <= 1
            low_x, low_y, high_x, high_y = outline.bounds
            assert min(low_x, low_y) >= -1e-9
            assert high_x <= width_m + 1e-9
            assert high_y <= depth_m + 1e-9
        assert all(a.intersection(b).area == 0 for a, b in combinations(outlines, 2))


def test_courtyard_is_open_in_its_middle():
    parts = shapes.around_courtyard(30.0, 30.0, np.random.default_rng(0))
    assert not any(Polygon(part.outline).buffer(3).contains(Polygon([(14, 14), (16, 14), (15, 16)])) for part in parts)
