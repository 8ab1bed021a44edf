import numpy as np
from shapely import LineString, Point

from coopsim.world.towns.streets.line_kernels import distances_to_lines, keep_corners


def test_distances_are_to_the_nearest_edge_of_all_lines():
    rng = np.random.default_rng(0)
    starts, ends, widths = rng.uniform(-9, 9, (6, 2)), rng.uniform(-9, 9, (6, 2)), rng.uniform(0, 2, 6)
    points = rng.uniform(-12, 12, (50, 2))
    expected = [
        min(LineString([a, b]).distance(Point(point)) - w for a, b, w in zip(starts, ends, widths, strict=True))
        for point in points
    ]
    np.testing.assert_allclose(distances_to_lines(points, starts, ends, widths), expected, atol=1e-9)


def test_line_through_fewer_points_stays_close():
    angle = np.linspace(0, np.pi, 200)
    points = 10 * np.column_stack([np.cos(angle), np.sin(angle)])
    kept = points[keep_corners(points, 0.2)]
    assert len(kept) < 15
    line = LineString(kept)
    assert max(line.distance(Point(point)) for point in points) <= 0.2 + 1e-9


def test_straight_line_keeps_its_ends_only():
    kept = keep_corners(np.column_stack([np.arange(9.0), np.arange(9.0)]), 0.01)
    assert np.flatnonzero(kept).tolist() == [0, 8]


def test_of_points_as_far_from_the_line_the_first_is_kept_however_their_coordinates_are_rounded() -> None:
    angle = np.linspace(0.0, np.pi, 200)
    arc = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    kept = [keep_corners(arc + np.random.default_rng(seed).normal(0.0, 1e-13, arc.shape), 0.2) for seed in range(8)]
    assert 3 < kept[0].sum() < 40
    assert all(np.array_equal(each, kept[0]) for each in kept)
