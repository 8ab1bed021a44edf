"""Parts of maps: what a circle leaves of a junction, of lanes, and of what stands beside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny_maps import SUMO, THREE_ROADS, written

from coopsim.data.maps.place.candidates import TWO_LEVELS, places_of
from coopsim.data.maps.place.cut import MARGIN_M, cut_out, distances_m
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetLane, StreetMap

JUNCTION = (110.0, -5.0)


@pytest.fixture
def streets(tmp_path: Path) -> StreetMap:
    return read_map(written(tmp_path, THREE_ROADS, "map.xodr"))


def lane(name: str, *points: tuple[float, ...], **more: str) -> StreetLane:
    line = np.array([[*point, 0.0][:3] for point in points])
    return StreetLane(name, name, "drive", line, np.full(len(line), 3.0), **more)


def map_of(*lanes: StreetLane, **links: tuple[str, ...]) -> StreetMap:
    return StreetMap(
        source="x", format="x", lanes={each.id: each for each in lanes}, links=links, ways={}, junctions={}
    )


def test_lanes_end_at_the_circle_and_the_centre_moves(streets: StreetMap) -> None:
    found = cut_out(streets, JUNCTION, 60.0)
    assert set(found.ways) == set(streets.ways) and set(found.junctions) == {"9"}
    arriving = found.lanes["1.0.-1"]
    assert np.hypot(*arriving.line[0, :2]) == pytest.approx(60.0)
    assert arriving.line[-1] == pytest.approx([-10.0, 3.25, 0.0])
    assert found.ways["1.0.-1>2.0.-1"].line[0] == pytest.approx([-10.0, 3.25, 0.0])
    assert found.offset_m == pytest.approx((111.0, -3.0, 3.0))


def test_what_lies_outside_is_left_out_and_walls_end_at_the_circle(streets: StreetMap) -> None:
    found = cut_out(streets, JUNCTION, 85.0)
    assert [each.id for each in found.crossings] == ["1.1"] and found.signals[0].lanes == ("1.0.-1",)
    assert {each.kind for each in found.solids} == {"building", "tree", "wall", "pole"}
    (wall,) = (each for each in found.solids if each.kind == "wall")
    assert np.hypot(*wall.line[:, :2].T).max() == pytest.approx(85.0)
    assert cut_out(streets, JUNCTION, 40.0).solids == ()


def test_a_junction_that_comes_close_to_the_circle_is_left_out(streets: StreetMap) -> None:
    reach_m = max(float(np.hypot(*(way.line[:, :2] - JUNCTION).T).max()) for way in streets.ways.values())
    assert cut_out(streets, JUNCTION, reach_m + MARGIN_M + 1.0).ways
    assert not cut_out(streets, JUNCTION, reach_m + MARGIN_M - 1.0).ways


def test_a_lane_that_comes_in_again_goes_on_by_another_name() -> None:
    bow = lane("a", (-100, 0), (0, 0), (0, 200), (50, 200), (50, 0), (200, 0))
    found = cut_out(map_of(bow, lane("b", (200, 0), (300, 0)), a=("b",)), (0.0, 0.0), 120.0)
    assert set(found.lanes) == {"a", "a/2"} and found.links == {}
    assert found.lanes["a"].line[-1] == pytest.approx([0.0, 120.0, 0.0])
    assert found.lanes["a/2"].line[-1] == pytest.approx([120.0, 0.0, 0.0])


def test_neighbours_are_those_of_the_same_piece() -> None:
    both = lane("a", (-200, 0), (200, 0), left="b"), lane("b", (-200, 3), (200, 3), right="a")
    found = cut_out(map_of(*both), (0.0, 0.0), 100.0)
    assert (found.lanes["a"].left, found.lanes["b"].right) == ("b", "a")
    assert cut_out(map_of(both[0]), (0.0, 0.0), 100.0).lanes["a"].left is None


def test_stubs_that_lead_to_no_junction_are_left_out() -> None:
    stub, street = lane("stub", (0, 90), (0, 130)), lane("street", (-50, 0), (50, 0))
    assert set(cut_out(map_of(stub, street), (0.0, 0.0), 100.0).lanes) == {"street"}


def test_distances_are_to_lines_and_not_to_their_points() -> None:
    lines = [np.array([[-100.0, 3, 0], [100, 3, 0]]), np.array([[10.0, 0, 0], [20, 0, 0]])]
    assert distances_m(lines, np.zeros(2)) == pytest.approx([3.0, 10.0])


def test_a_program_stays_with_its_ways(tmp_path: Path) -> None:
    streets = read_map(written(tmp_path, SUMO, "map.net.xml"))
    assert set(cut_out(streets, (105.0, -2.0), 60.0).programs) == {"J"}
    assert cut_out(streets, (-40.0, -2.0), 120.0).programs == {}


def test_without_junctions_of_several_roads_long_lanes_are_places() -> None:
    streets = map_of(lane("a", (-50, 0), (0, 0), (50, 0)), lane("b", (50, 0), (60, 0)))
    assert places_of(streets, 50.0).centres == pytest.approx(np.zeros((1, 2)))


def test_places_near_a_bridge_are_left_out() -> None:
    roads = lane("a", (-50, 0, 0), (0, 0, 0), (50, 0, 0)), lane("b", (0, -50, 6), (0, 50, 6))
    far = lane("c", (500, -40, 0), (500, 0, 0), (500, 40, 0))
    found = places_of(map_of(*roads, far), 100.0)
    assert found.centres == pytest.approx(np.array([[500.0, 0.0]])) and found.left_out == {TWO_LEVELS: 2}


def test_each_next_place_is_the_farthest_one() -> None:
    lanes = [lane(str(x), (x - 40.0, 0), (x, 0), (x + 40.0, 0)) for x in (0, 100, 300, 1000)]
    assert places_of(map_of(*lanes), 50.0).centres[:, 0].tolist() == [300.0, 1000.0, 0.0, 100.0]
