"""Furniture stands where streets have it: not on roads, ways, crosswalks, in bays, buildings or in other furniture."""

from collections import Counter
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
import shapely

from coopsim.world.custom.place import place_from
from coopsim.world.furniture.furnish import furnish
from coopsim.world.furniture.furnished import leafy, with_furniture
from coopsim.world.furniture.furnishing import furnishing_parts
from coopsim.world.furniture.kept_free import lanes_of, lines_of
from coopsim.world.furniture.stations import street_sides
from coopsim.world.places.layout import Layout, lane_outline
from coopsim.world.scenario import SCENARIOS, make_scenario
from coopsim.world.towns.drawn_place import describe_streets, draw_place, turned

PLACES = ("crossing", "parking_street", "roundabout", "urban_grid", "merge", "highway", "town 3", "town 8")
_HEAD_M = 2.0


@lru_cache
def furnished(name: str) -> tuple[Layout, list[dict[str, Any]]]:
    if name.startswith("town"):
        layout = draw_place(int(name.split()[1])).make_layout()
        description = draw_place(int(name.split()[1])).description
        assert description is not None
        return layout, description["furniture"]
    layout = SCENARIOS.get(name).make_layout()
    return layout, furnish(layout, 1)


@lru_cache
def footprints(name: str) -> tuple[list[str], Any]:
    """Return the kinds of all pieces, and what each covers below people's heads."""
    kinds, shapes = [], []
    for entry in furnished(name)[1]:
        points = [part.vertices[part.vertices[:, 2] < _HEAD_M, :2] for part in furnishing_parts([entry])]
        if "along" in entry:
            shapes.append(shapely.LineString(entry["along"]).buffer(0.02, cap_style="flat"))
        else:
            shapes.append(shapely.convex_hull(shapely.MultiPoint(np.concatenate(points))))
        kinds.append(entry["kind"])
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
        counts.update(entry["kind"] for entry in entries)
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
        for x, y in entry.get("along", [entry.get("at")]):
            assert x == round(x, 3) and y == round(y, 3)


def test_crowns_do_not_reach_into_buildings_or_masts() -> None:
    layout, entries = furnished("urban_grid")
    solid = shapely.union_all([shapely.Polygon(outline) for outline in layout.road_map.buildings])
    trees = [entry for entry in entries if entry["kind"] == "tree"]
    assert trees and layout.road_map.buildings and layout.rsus
    for tree in trees:
        spot = shapely.Point(tree["at"])
        assert spot.distance(solid) > tree["crown_m"] / 2 - 0.2
        assert min(np.hypot(*(rsu.translation[:2] - tree["at"])) for rsu in layout.rsus) > tree["crown_m"] / 2


def test_a_furnished_layout_is_furnished_around_what_it_has() -> None:
    layout = SCENARIOS.get("crossing").make_layout()
    bench = {"kind": "bench", "at": [40.0, -9.0], "heading_deg": 90.0}
    again = furnish(with_furniture(layout, [bench]), 1)
    spots = [entry["at"] for entry in again if "at" in entry]
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
    again = turned({"furniture": others}, -angle)["furniture"]
    spots, back = ([(each["kind"], *(each.get("at") or each["along"][0])) for each in one] for one in (entries, again))
    found = [any(kind == other and np.hypot(x - u, y - v) < 0.02 for other, u, v in back) for kind, x, y in spots]
    # Coordinates are rounded to millimetres, so that here and there a piece just fits in one of the two.
    assert np.mean(found) > 0.95 and abs(len(spots) - len(back)) < 0.05 * len(spots)
