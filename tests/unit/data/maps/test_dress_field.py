"""Distances from roads on a grid, and the lines of equal distance around them."""

import numpy as np
import pytest
from crossroads import crossroads
from shapely import LineString, Point, Polygon, union_all

from coopsim.data.maps.dress.field import field_of
from coopsim.data.maps.dress.roads import roads_of
from coopsim.data.maps.dress.surfaces import area_m2, convex_parts, off_road
from coopsim.data.maps.dress.ways import runs

PIECES = np.array([[0, 0, 40, 3, 2, 3], [20, -25, 20, 25, 1.5, 1.5], [60, 0, 60, 0, 4, 4.0]])


def surface():
    cone = [Point(PIECES[0, :2]).buffer(2, 64), Point(PIECES[0, 2:4]).buffer(3, 64)]
    strips = [union_all(cone).convex_hull]
    return union_all([*strips, LineString([(20, -25), (20, 25)]).buffer(1.5, 64), Point(60, 0).buffer(4, 64)])


def test_distances_are_those_from_the_surface():
    field, exact = field_of(PIECES), surface()
    points = np.random.default_rng(0).uniform([-10, -30], [70, 30], (400, 2))
    expected = np.minimum([exact.distance(Point(point)) for point in points], 12.0)
    outside = expected > 0
    assert np.abs(field.at(points)[outside] - expected[outside]).max() < 0.3
    assert (field.at(points)[~outside] < 0.3).all()


@pytest.mark.parametrize("level_m", [0.0, 2.6])
def test_lines_go_around_every_part_with_the_surface_on_their_left(level_m):
    lines = field_of(PIECES).lines(level_m)
    assert len(lines) == 2 and all(area_m2(line) > 0 for line in lines)
    grown = surface().buffer(level_m, 64)
    assert sum(area_m2(line) for line in lines) == pytest.approx(grown.area, rel=0.02)
    assert union_all([Polygon(line) for line in lines]).symmetric_difference(grown).area < 0.03 * grown.area


def test_a_ring_has_a_line_within_it_the_other_way_round():
    angle = np.linspace(0, 2 * np.pi, 41)
    circle = 20 * np.column_stack([np.cos(angle), np.sin(angle)])
    pieces = np.column_stack([circle[:-1], circle[1:], np.full((40, 2), 2.0)])
    inner, outer = sorted(field_of(pieces).lines(1.0), key=area_m2)
    assert area_m2(inner) == pytest.approx(-np.pi * 17**2, rel=0.02)
    assert area_m2(outer) == pytest.approx(np.pi * 23**2, rel=0.02)


def test_what_lies_on_a_road_is_cut_away():
    roads = roads_of(crossroads())
    corner = np.array([[1.0, 1.0], [30.0, 1.0], [30.0, 30.0], [1.0, 30.0]])
    inside, far = corner * 0.05, corner + 60.0
    parts = off_road([corner, inside, far], roads.field)
    assert any(np.array_equal(part, far) for part in parts)
    kept = union_all([Polygon(part) for part in parts])
    free = np.random.default_rng(0).uniform(1, 30, (500, 2))
    away_m = roads.field.at(free)
    held = np.array([kept.distance(Point(point)) < 0.01 for point in free])
    assert held[away_m > 0.1].mean() > 0.99 and not held[away_m < -0.15].any()
    assert min(roads.field.at(part).min() for part in parts) > -0.11


OUTLINES = {
    "l": [[0, 0], [10, 0], [10, 4], [4, 4], [4, 10], [0, 10]],
    "u": [[0, 0], [12, 0], [12, 9], [9, 9], [9, 3], [3, 3], [3, 9], [0, 9]],
    "square": [[0, 0], [5, 0], [5, 5], [0, 5]],
}


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize("way", [1, -1])
def test_concave_outlines_become_few_convex_parts(name, way):
    outline = np.array(OUTLINES[name][::way], dtype=np.float64)
    parts = convex_parts(outline)
    assert len(parts) <= {"l": 2, "u": 3, "square": 1}[name]
    assert all(area_m2(part) == pytest.approx(Polygon(part).convex_hull.area) for part in parts)
    assert union_all([Polygon(part) for part in parts]).symmetric_difference(Polygon(outline)).area < 1e-6


def test_an_outline_that_crosses_itself_ends():
    bow = np.array([[0, 0], [4, 4], [4, 0], [0, 4.0]])
    assert sum(area_m2(part) for part in convex_parts(bow)) <= 16.0


def test_short_gaps_of_a_line_are_closed_and_short_lines_left_out():
    angle = np.linspace(0, 2 * np.pi, 201)[:-1]
    ring = 40 * np.column_stack([np.cos(angle), np.sin(angle)])  # 1.26 m between points
    none, every = np.zeros(200, np.bool_), np.ones(200, np.bool_)
    wanted = every.copy()
    wanted[10:30] = False  # 25 m
    assert len(runs(ring, wanted, none)[0]) == 201
    assert [len(run) for run in runs(ring, wanted, ~wanted)] == [180]
    wanted[50:100] = False  # 63 m
    assert [len(run) for run in runs(ring, wanted, none)] == [150]
    wanted[105:] = False  # 6 m and 50 m are left
    assert [len(run) for run in runs(ring, wanted, none)] == [50]
    assert runs(ring, none, none) == [] and runs(ring / 100, every, none) == []


def test_lines_are_closed_where_the_surface_leaves_the_grid():
    wide = field_of(PIECES).with_pieces(np.array([[20, 0, 200, 0, 3, 3.0]]))
    (outer,) = (line for line in wide.lines(1.0) if area_m2(line) > 0)
    steps_m = np.hypot(*(np.roll(outer, -1, axis=0) - outer).T)
    assert steps_m.max() < 1.5 and outer[:, 0].max() > 75.0
