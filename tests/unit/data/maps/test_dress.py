"""What stands beside the roads of a made map, and of given ones."""

import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from crossroads import ARM_M, crossroads, lane, line
from shapely import LineString, Polygon, union_all

from coopsim.data.maps.dress.roads import roads_of
from coopsim.data.maps.dress.surroundings import Surroundings, surroundings_of
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetArea, StreetCrossing, StreetMap, StreetSolid
from coopsim.world.custom.place import place_from
from coopsim.world.places.description import MapLane, PlaceDescription

DATA = Path(os.environ.get("COOPSIM_DATA", "nowhere")) / "maps"


def described(streets: StreetMap, surroundings: Surroundings) -> PlaceDescription:
    """Return a description whose roads are the lanes and ways of a map, as curved lanes."""
    nodes, roads = {}, []
    ends = {name: (f"{name}<", f"{name}>") for name, each in streets.lanes.items() if each.kind == "drive"}
    ends |= {name: (f"{way.start}>", f"{way.end}<") for name, way in streets.ways.items()}
    for name, (start, end) in ends.items():
        points = (streets.lanes | streets.ways)[name].line[:, :2]
        nodes |= {start: tuple(points[0].tolist()), end: tuple(points[-1].tolist())}
        roads.append(MapLane(start, end, via=tuple(map(tuple, points[1:-1].tolist())), curved=True, width_m=3.5))
    return PlaceDescription(nodes=nodes, roads=tuple(roads), cut=True, **surroundings.fields)


def straight(streets: StreetMap) -> StreetMap:
    """Return the map with the straight ways alone: the others bend too sharply to drive."""
    ways = {name: way for name, way in streets.ways.items() if abs(int(name[2]) - int(name[-1])) == 2}
    return replace(streets, ways=ways)


@pytest.mark.parametrize("walks", [False, True])
def test_a_place_with_it_can_be_built(walks):
    streets = straight(crossroads(walks=walks))
    found = surroundings_of(streets, 1)
    layout = place_from(described(streets, found), "made").make_layout()
    assert layout.footways is not None and layout.relief is not None
    assert len(layout.rsus) >= 1 and len(layout.road_map.buildings) > 20


def test_the_same_seed_draws_the_same():
    first, again, other = (surroundings_of(crossroads(), seed) for seed in (1, 1, 2))
    assert first.fields == again.fields and first.crosswalks == again.crosswalks
    assert first.fields["buildings"] != other.fields["buildings"]
    assert first.fields["walks"] == other.fields["walks"]


def test_pavements_are_beside_the_road_and_not_on_it():
    streets = crossroads(walks=True)
    road = union_all([LineString(each.line).buffer(1.6, cap_style="flat") for each in streets.lanes.values()
                      if each.kind == "drive"])  # fmt: skip
    paved = union_all([Polygon(each.outline) for each in surroundings_of(streets, 1).fields["paved"]
                       if each.kind == "pavement"])  # fmt: skip
    assert paved.intersection(road).area < 1.0
    walk = union_all([LineString(each.line).buffer(1.0, cap_style="flat") for each in streets.lanes.values()
                      if each.kind == "walk"])  # fmt: skip
    assert walk.difference(paved.buffer(0.05)).area < 0.01 * walk.area


def test_people_walk_around_corners_and_cross_at_made_crossings():
    walks = surroundings_of(crossroads(), 1).fields["walks"]
    assert len(walks.crosswalks) == 4
    ground = roads_of(crossroads()).field
    for way in walks.ways:
        points = np.array([walks.nodes[name] for name in way])
        assert (ground.at(points) > 1.5).all()
    for start, end in walks.crosswalks:
        a, b = np.array(walks.nodes[start]), np.array(walks.nodes[end])
        assert ground.at(a + np.linspace(0, 1, 20)[:, None] * (b - a)).min() < -1.0


def test_no_way_leads_beyond_the_end_of_a_lane():
    walks = surroundings_of(crossroads(), 1).fields["walks"]
    assert np.abs(np.array(list(walks.nodes.values()))).max() < ARM_M + 3.0


def test_crossings_of_a_map_have_their_nodes():
    over = line((40.0, -3.5), (40.0, 3.5))
    streets = crossroads(crossings=(StreetCrossing("zebra", over, 3.0), StreetCrossing("far", over + 900.0, 3.0)))
    found = surroundings_of(streets, 1)
    assert list(found.crosswalks) == ["zebra"]
    walks = found.fields["walks"]
    assert walks.crosswalks == (found.crosswalks["zebra"],)
    ends = np.array([walks.nodes[name] for name in found.crosswalks["zebra"]])
    np.testing.assert_allclose(ends, [[40.0, -6.1], [40.0, 6.1]], atol=0.3)


def test_fast_roads_have_no_people_and_no_houses_along_them():
    fields = surroundings_of(crossroads(speed_m_s=30.0), 1).fields
    assert fields["walks"] is None and fields["walls"] == ()
    assert not any(each.windows for each in fields["buildings"])  # sheds, well away from the road
    assert fields["trees"]


def test_houses_of_a_map_stand_where_it_says_and_not_on_roads():
    outline = np.array([[20, 10], [50, 10], [50, 40], [40, 40], [40, 20], [20, 20]], dtype=np.float64)
    across = outline - [0.0, 30.0]  # over the street
    solids = tuple(
        StreetSolid(name, "building", np.column_stack([each, np.zeros(6)]), height_m)
        for name, each, height_m in (("house", outline, 12.5), ("bridge", across, None))
    )
    fields = surroundings_of(crossroads(solids=solids), 3).fields
    parts = [each for each in fields["buildings"] if each.height_m == 12.5]
    assert union_all([Polygon(each.outline) for each in parts]).symmetric_difference(Polygon(outline)).area < 0.1
    others = [Polygon(each.outline) for each in fields["buildings"] if each not in parts]
    assert not any(each.intersection(Polygon(outline)).area > 0.1 for each in others)
    ground = roads_of(crossroads()).field
    assert min(ground.at(np.array(each.outline)).min() for each in fields["buildings"]) > 0.2


def test_walls_trees_and_poles_of_a_map_are_kept_off_roads():
    angle = np.arange(8) * np.pi / 4
    ring = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.zeros(8)])
    solids = (
        StreetSolid("wall", "wall", line((30.0, 9.0), (60.0, 9.0), (60.0, -40.0)), 1.8, 0.3),
        StreetSolid("tree", "tree", ring + np.array([30.0, 20.0, 0.0]), 11.0),
        StreetSolid("on the road", "tree", ring + np.array([30.0, 2.0, 0.0]), 11.0),
        StreetSolid("pole", "pole", ring / 20 + [25.0, 7.0, 0.0], None),
    )
    fields = surroundings_of(crossroads(speed_m_s=30.0, solids=solids), 1).fields
    assert [each.along for each in fields["walls"]] == [((30.0, 9.0), (60.0, 9.0))]
    assert [each.at for each in fields["trees"] if each.height_m == 11.0] == [(30.0, 20.0)]
    assert [(each.kind, each.at) for each in fields["furniture"]] == [("pole", (25.0, 7.0))]


def test_vehicles_park_where_the_map_has_room():
    lot = np.array([[60, 20], [100, 20], [100, 50], [60, 50.0]])
    space = np.array([[20, 20], [25, 20], [25, 22.5], [20, 22.5]])
    streets = crossroads(areas=(StreetArea("lot", "park", lot), StreetArea("space", "park", space)))
    strip = lane("strip", "park", line((30.0, 4.6), (90.0, 4.6)), 2.2)
    found = surroundings_of(replace(streets, lanes={**streets.lanes, "strip": strip}), 1).fields
    at = np.array([bay.at for bay in found["parked"]])
    assert (np.abs(at - [22.5, 21.25]) < 0.01).all(axis=1).sum() == 1
    assert ((at > [60, 20]) & (at < [100, 50])).all(axis=1).sum() >= 20
    beside = at[np.abs(at[:, 1] - 4.9) < 0.5]
    assert len(beside) == 8 and (np.abs(beside[:, 1]) >= 1.75 + 3.0).all()


def test_units_face_the_busiest_junction_from_two_corners():
    units = surroundings_of(crossroads(), 1).fields["rsus"]
    ground = roads_of(crossroads()).field
    at = np.array([unit.at for unit in units])
    assert len(units) == 2 and (ground.at(at) > 0.9).all()
    assert np.allclose([unit.look_at for unit in units], 0.0, atol=1e-6)
    assert at[0] @ at[1] < 0 and np.abs(at).max() < 20.0


@pytest.mark.skipif(not DATA.is_dir(), reason="needs the maps of COOPSIM_DATA")
def test_a_city_has_all_of_it():
    streets = read_map(DATA / "sumo" / "cologne3.net.xml")
    fields = surroundings_of(streets, 1).fields
    ground = roads_of(streets).field
    assert len(fields["buildings"]) > 200 and len(fields["walks"].crosswalks) > 10
    assert min(ground.at(np.array(each.outline)).min() for each in fields["buildings"]) > 0.2
    assert (ground.at(np.array([unit.at for unit in fields["rsus"]])) > 0.9).all()


def test_paths_that_meet_have_one_node_there():
    paths = (line((60.0, 60.0), (100.0, 60.0)), line((100.0, 60.0), (100.0, 100.0)), line((100.3, 60.0), (140.0, 60.0)))
    more = {f"path{k}": lane(f"path{k}", "walk", each, 2.0) for k, each in enumerate(paths)}
    streets = crossroads(walks=True)
    walks = surroundings_of(replace(streets, lanes={**streets.lanes, **more}), 1).fields["walks"]
    pairs = [pair for way in (*walks.ways, *walks.crosswalks) for pair in pairwise(way)]
    lengths_m = [np.hypot(*np.subtract(walks.nodes[a], walks.nodes[b])) for a, b in pairs]
    assert min(lengths_m) > 0.2
    (corner,) = (name for name, at in walks.nodes.items() if np.hypot(at[0] - 100.0, at[1] - 60.0) < 0.5)
    assert sum(corner in pair for pair in pairs) == 3


def test_lanes_that_end_side_by_side_go_on_in_one_direction_and_others_in_their_own():
    """Lanes of a bend end at a circle with other headings: each by its own, they would spread as a brush."""
    ends = {"a": ((0.0, 0.0), (50.0, 0.0)), "b": ((0.0, 3.5), (50.0, 8.0)), "back": ((0.0, 40.0), (0.0, -50.0))}
    lanes = {name: lane(name, "drive", line(*points)) for name, points in ends.items()}
    roads = roads_of(replace(crossroads(), lanes=lanes, ways={}, junctions={}))
    onward = {tuple(piece[:2]): piece[2:4] - piece[:2] for piece in roads.pieces[roads.beyond]}
    np.testing.assert_allclose(onward[50.0, 0.0], onward[50.0, 8.0], atol=1e-9)
    assert onward[50.0, 0.0][1] > 0.0
    np.testing.assert_allclose(onward[0.0, -50.0], [0.0, -60.0], atol=1e-9)
