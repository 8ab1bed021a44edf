"""Tests of the geometry of towns."""

import numpy as np
import pytest
from shapely import LineString, Point, Polygon

from coopsim.geometry.outlines import convex_pieces, distances_to_lines, keep_corners
from coopsim.geometry.taken_ground import TakenGround
from coopsim.world.places.layout import rectangle


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


def turned_rectangle(rng):
    angle = rng.uniform(0, np.pi)
    corners = rectangle((0, rng.uniform(1, 8)), (0, rng.uniform(1, 8)))
    return corners @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]] + rng.uniform(-8, 8, 2)


def test_taken_ground_is_what_overlaps():
    rng, taken = np.random.default_rng(0), TakenGround()
    outlines = [turned_rectangle(rng) for _ in range(4)]
    for outline in outlines:
        taken.take(outline)
    for _ in range(300):
        outline = turned_rectangle(rng)
        overlaps = any(Polygon(outline).intersection(Polygon(other)).area > 1e-9 for other in outlines)
        assert taken.is_free(outline) != overlaps


def test_free_ground_is_as_far_away_as_asked_for():
    rng, taken = np.random.default_rng(1), TakenGround()
    line = np.array([[-5.0, -3.0], [4.0, 2.0]])
    taken.take(line, 1.5)
    free = [outline for outline in (turned_rectangle(rng) for _ in range(300)) if taken.is_free(outline, 0.5)]
    assert 0 < len(free) < 300
    assert min(Polygon(outline).distance(LineString(line)) for outline in free) >= 2.0 - 1e-9


@pytest.mark.parametrize(("at", "free"), [(1.9, False), (2.1, True)])
def test_gap_along_a_side(at, free):
    taken = TakenGround()
    taken.take(rectangle((0, 1), (0, 1)))
    assert taken.is_free(rectangle((at, 3), (0, 1)), 1.0) == free


def test_nothing_is_taken_where_one_part_does_not_fit():
    taken = TakenGround()
    taken.take(rectangle((0, 1), (0, 1)))
    assert not taken.try_take([rectangle((5, 6), (0, 1)), rectangle((0, 2), (0, 1))])
    assert taken.try_take([rectangle((5, 6), (0, 1))])
    assert not taken.is_free(rectangle((5, 6), (0, 1)))


def test_taken_ground_grows():
    taken = TakenGround()
    for k in range(600):
        taken.take(rectangle((2 * k, 2 * k + 1), (0, 1)))
    assert not taken.is_free(rectangle((1000.2, 1000.4), (0, 1)))
    assert taken.is_free(rectangle((1001.2, 1001.4), (0, 1)))
