"""Furniture stands where streets have it: not on roads, ways, crosswalks, in bays, buildings or in other furniture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.lidar.expected_returns import ReturnsEstimator
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.sensors.lidar.ray_grid import RayGrid
from coopsim.sensors.scene import RayScene, static_triangles
from coopsim.world.custom.place import place_from
from coopsim.world.furniture.free_ground import lanes_of, lines_of
from coopsim.world.furniture.furnish import (
    furnish,
    furnishing_parts,
    lane_paint,
    leafy,
    line_pieces,
    with_furniture,
)
from coopsim.world.furniture.sides import street_sides
from coopsim.world.places.crossings import make_crossing
from coopsim.world.places.description import MapFurniture
from coopsim.world.places.layout import Layout, lane_outline
from coopsim.world.scenario import SCENARIOS, make_scenario
from coopsim.world.snapshot import Actors
from coopsim.world.towns.town import describe_streets, draw_place, turned

PLACES = ("crossing", "parking_street", "roundabout", "urban_grid", "merge", "highway", "town 3", "town 8")
_HEAD_M = 2.0


@lru_cache
def furnished(name: str) -> tuple[Layout, Sequence[MapFurniture]]:
    if name.startswith("town"):
        layout = draw_place(int(name.split()[1])).make_layout()
        description = draw_place(int(name.split()[1])).description
        assert description is not None and description.furniture is not None
        return layout, description.furniture
    layout = SCENARIOS.get(name).make_layout()
    return layout, furnish(layout, 1)


@lru_cache
def footprints(name: str) -> tuple[list[str], Any]:
    """Return the kinds of all pieces, and what each covers below people's heads."""
    kinds, shapes = [], []
    for entry in furnished(name)[1]:
        points = [part.vertices[part.vertices[:, 2] < _HEAD_M, :2] for part in furnishing_parts([entry])]
        if entry.along:
            shapes.append(shapely.LineString(entry.along).buffer(0.02, cap_style="flat"))
        else:
            shapes.append(shapely.convex_hull(shapely.MultiPoint(np.concatenate(points))))
        kinds.append(entry.kind)
    return kinds, np.array(shapes)


def some_in(name: str, areas: list[Any], apart_m: float = 0.0) -> list[str]:
    """Return the kinds of pieces nearer to an area than `apart_m`."""
    kinds, shapes = footprints(name)
    near = (
        shapely.distance(shapes, shapely.union_all(areas)) < apart_m
        if apart_m
        else shapely.intersects(shapes, shapely.union_all(areas))
    )
    return [kinds[k] for k in np.flatnonzero(near)]


@pytest.mark.parametrize("name", PLACES)
def test_nothing_stands_on_the_road(name: str) -> None:
    layout, entries = furnished(name)
    assert len(entries) > 20
    lanes = [shapely.Polygon(quad) for lane in layout.network.lanes.values() for quad in lane_outline(lane)]
    ground = [*layout.road_map.lanes, *layout.road_map.crosswalks, *layout.road_map.parking]
    assert some_in(name, [*lanes, *map(shapely.Polygon, ground)], 0.2) == []


@pytest.mark.parametrize("name", PLACES)
def test_nothing_stands_in_peoples_way_or_in_buildings(name: str) -> None:
    layout, _ = furnished(name)
    ways = [line for ways in (layout.footways, layout.cycleways) if ways is not None for line in lines_of(ways)]
    if ways:
        assert some_in(name, [shapely.LineString(line) for line in ways], 0.8) == []
    solid = [*layout.road_map.buildings, *layout.road_map.walls]
    if solid:
        assert some_in(name, [shapely.Polygon(outline) for outline in solid]) == []
    spots = [shapely.Point(rsu.translation[:2]) for rsu in layout.rsus]
    assert some_in(name, spots, 0.3) == []
    bays = [shapely.Point(bay.x_m, bay.y_m) for bay in layout.bays]
    if bays:
        assert some_in(name, bays, 1.2) == []


@pytest.mark.parametrize("name", PLACES)
def test_nothing_stands_in_another_piece(name: str) -> None:
    kinds, shapes = footprints(name)
    first, second = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    pairs = {(kinds[a], kinds[b]) for a, b in zip(first, second, strict=True) if a < b}
    leafy = {"bush", "hedge", "planter"}  # leaves may touch
    assert {pair for pair in pairs if not leafy & set(pair)} == set()


def test_densities_are_as_stated() -> None:
    places = [furnished(name) for name in ("crossing", "roundabout", "urban_grid", "town 3", "town 8")]
    counts, kerb_m = Counter[str](), 0.0
    for layout, entries in places:
        counts.update(entry.kind for entry in entries)
        area = np.array([[-600.0, -600.0], [600.0, 600.0]])
        kerb_m += street_sides(layout, area, lanes_of(layout, area)).first_m[-1]
    apart_m = {kind: kerb_m / counts[kind] for kind in ("lamp", "sign", "hydrant", "bin", "bench")}
    # Along both sides of a street: every 30 m a lamp, so every 60 m on each; some do not fit.
    assert 54 < apart_m["lamp"] < 90
    assert 40 < apart_m["sign"] < 110
    assert 150 < apart_m["hydrant"] < 500
    assert 60 < apart_m["bench"] < 250
    assert 80 < apart_m["bin"] < 350


def test_numbers_are_whole_millimetres_and_depend_on_the_seed_alone() -> None:
    layout, entries = furnished("crossing")
    assert furnish(layout, 1) == entries != furnish(layout, 2)
    for entry in entries:
        for x, y in entry.along or [entry.at]:
            assert x == round(x, 3) and y == round(y, 3)


def test_crowns_do_not_reach_into_buildings_or_masts() -> None:
    layout, entries = furnished("urban_grid")
    solid = shapely.union_all([shapely.Polygon(outline) for outline in layout.road_map.buildings])
    trees = [entry for entry in entries if entry.kind == "tree"]
    assert trees and layout.road_map.buildings and layout.rsus
    for tree in trees:
        spot = shapely.Point(tree.at)
        assert spot.distance(solid) > tree.crown_m / 2 - 0.2
        assert min(np.hypot(*(rsu.translation[:2] - tree.at)) for rsu in layout.rsus) > tree.crown_m / 2


def test_a_furnished_layout_is_furnished_around_what_it_has() -> None:
    layout = SCENARIOS.get("crossing").make_layout()
    bench = MapFurniture("bench", (40.0, -9.0), 90.0)
    again = furnish(with_furniture(layout, [bench]), 1)
    spots = [entry.at for entry in again if entry.at is not None]
    assert min(np.hypot(x - 40.0, y + 9.0) for x, y in spots) > 0.5


def test_full_detail_furnishes_named_scenarios_always_alike() -> None:
    plain, full, again = (make_scenario("crossing", detail=detail) for detail in ("plain", "full", "full"))
    assert plain.static == plain.layout.static and len(full.static) > len(plain.static) + 100
    for one, other in zip(full.static[len(plain.static) :], again.static[len(plain.static) :], strict=True):
        assert one.name == other.name and np.array_equal(one.vertices, other.vertices)


def test_furniture_turns_with_the_place() -> None:
    description, angle = leafy(describe_streets(8)), 0.7
    entries, others = (
        furnish(place_from(each, "town").make_layout(), 5) for each in (description, turned(description, angle))
    )
    again = [turned(each, -angle) for each in others]
    spots, back = ([(each.kind, *(each.at or each.along[0])) for each in one] for one in (entries, again))
    found = [any(kind == other and np.hypot(x - u, y - v) < 0.02 for other, u, v in back) for kind, x, y in spots]
    # Coordinates are rounded to millimetres, so that here and there a piece just fits in one of the two.
    assert np.mean(found) > 0.95 and abs(len(spots) - len(back)) < 0.05 * len(spots)


def test_pieces_stand_at_their_place_and_heading() -> None:
    (wood, _) = furnishing_parts([MapFurniture("bench", (10.0, 5.0), 90.0)])
    low, high = wood.vertices.min(axis=0), wood.vertices.max(axis=0)
    assert (low + high)[:2] / 2 == pytest.approx([10.0, 5.0], abs=0.05)
    assert high[0] - low[0] == pytest.approx(1.8, abs=1e-6), "it looks along y, so it is long along x"
    back = wood.vertices[wood.vertices[:, 2] > 0.6]
    assert back[:, 1].max() < 5.0, "its back is behind"
    (cabinet,) = furnishing_parts([MapFurniture("cabinet", (10.0, 5.0), 90.0)])
    assert cabinet.boxes is not None and cabinet.boxes[0, 6] == pytest.approx(np.pi / 2)
    assert cabinet.boxes[0, :2] == pytest.approx([10.0, 5.0])


def test_lines_are_cut_into_pieces_of_one_length() -> None:
    middles, headings, lengths = line_pieces(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 3.0]]), 4.0)
    assert lengths == pytest.approx([10 / 3] * 3 + [3.0]) and headings == pytest.approx([0, 0, 0, np.pi / 2])
    assert middles[0] == pytest.approx([10 / 6, 0.0]) and middles[-1] == pytest.approx([10.0, 1.5])
    fence = furnishing_parts([MapFurniture("fence", along=((0, 0), (10, 0)), height_m=1.5)])
    points = np.concatenate([part.vertices for part in fence])
    assert points[:, 0].min() == pytest.approx(0.0, abs=0.1) and points[:, 0].max() == pytest.approx(10.0, abs=0.1)
    assert points[:, 2].max() == pytest.approx(1.5, abs=0.06)


def test_the_ground_lifts_pieces() -> None:
    entries = [MapFurniture("bin", (x, 0.0), 0.0) for x in (0.0, 10.0)]
    (low,), (high,) = (
        [part for part in furnishing_parts(entries, lambda points: 0.012 * points[:, 0]) if where(part.vertices[0, 0])]
        for where in (lambda x: x < 5, lambda x: x > 5)
    )
    assert low.vertices[:, 2].min() == pytest.approx(0.0) and high.vertices[:, 2].min() == pytest.approx(0.12)
    assert low.boxes is not None and high.boxes is not None
    assert high.boxes[:, 2] - low.boxes[:, 2] == pytest.approx(0.12)


def test_no_furniture_is_no_mesh() -> None:
    assert furnishing_parts([]) == ()


@pytest.mark.parametrize("name", ["crossing", "parking_street"])
def test_the_ray_grid_senses_furniture_as_embree_does(name: str) -> None:
    triangles = static_triangles(make_scenario(name, detail="full").static)
    pattern = PATTERNS.get("VLP-16")
    pose = SE3(Rotation.from_euler("xyz", [0.01, -0.02, 0.3]).as_matrix(), np.array([-30.3, -1.7, 1.9]))
    hits = RayGrid(pattern.elevation_rad, pattern.offset_rad, 720).cast(triangles, pose)
    expected = RayScene(triangles).cast(pose.translation, pose.rotate(pattern.directions(720)))
    ours, theirs = hits.range_m.ravel(), expected.range_m
    same = np.isclose(ours, theirs, atol=1e-3) | (np.isinf(ours) & np.isinf(theirs))
    # A ray that passes within rounding of an edge may take either side of it: there are many edges among leaves.
    assert same.mean() > 0.9995
    assert (expected.face >= 0).mean() > 0.3


def test_furniture_hides_where_no_rays_are_cast() -> None:
    boxes = Boxes3D(np.array([[20.0, 0.0, 0.8]]), np.array([[4.0, 1.8, 1.6]]), np.array([np.pi / 2]))
    one = np.ones(1, np.int64)
    car = Actors(one, boxes, np.zeros((1, 2)), 0 * one, 0 * one, np.zeros((1, 3), dtype=np.uint8))

    def returns(*entries: MapFurniture) -> int:
        sight = ReturnsEstimator(furnishing_parts(entries), PATTERNS.get("HDL-64E"), 1800, 100.0)
        return int(sight.expected_returns(np.array([[0.0, 0.0, 1.5]]), car, [None])[0, 0])

    free = returns()
    assert free > 200
    assert returns(MapFurniture("lamp", (10.0, 0.0), 0.0)) == free, "too thin to count"
    hedge = MapFurniture("hedge", along=((10.0, -9.0), (10.0, 9.0)), height_m=2.5)
    assert 0.02 * free < returns(hedge) < 0.5 * free, "some rays pass between leaves"
    trailer = [MapFurniture("trailer", (10.0, y), 90.0) for y in (-3.0, 0.0, 3.0)]
    assert returns(*trailer) < 0.5 * free


def _middles(layout: Layout) -> Floats:
    (part,) = lane_paint(layout)
    middles: Floats = part.vertices[part.faces].mean(axis=1)
    return middles


def test_lines_lie_just_above_a_flat_road() -> None:
    layout = make_crossing()
    middles = _middles(layout)
    assert len(middles) == 2 * len(layout.road_map.markings)
    assert ((middles[:, 2] > 0.0) & (middles[:, 2] < 0.03)).all()


def test_lines_lie_on_a_crowned_road_so_that_they_are_seen() -> None:
    layout = draw_place(1).make_layout()
    assert layout.relief is not None
    middles = _middles(layout)
    over_m = middles[:, 2] - layout.relief.heights(middles[:, :2])
    assert over_m.max() < 0.013
    seen = over_m > 0.0
    # The flat copies below the crown are hidden by it; every dash has a piece above it.
    assert seen.sum() >= len(layout.road_map.markings)
    assert (middles[seen, 2] > 0.02).any()
