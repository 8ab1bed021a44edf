"""A small network of SUMO: lanes, ways in parts, who yields, signals, crossings, polygons."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from tiny_maps import POLYGONS, SUMO, written

from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap


@pytest.fixture
def streets(tmp_path: Path) -> StreetMap:
    return read_map(written(tmp_path, SUMO, "a.net.xml"))


def test_lanes_are_as_they_are_written(streets: StreetMap) -> None:
    assert {name: lane.kind for name, lane in streets.lanes.items()} == {
        "A_0": "walk", "A_1": "drive", "A_2": "bus", "B_0": "drive", "C_0": "drive",
    }  # fmt: skip
    lane = streets.lanes["A_1"]
    assert (lane.left, lane.right, lane.speed_m_s, lane.width_m.tolist()) == ("A_2", None, 13.9, [3.2, 3.2])
    assert streets.lanes["B_0"].line.tolist() == [[110, -2, 0], [150, -2, 1.5], [210, -2, 0]]
    assert (streets.offset_m, streets.projection, streets.format) == ((1000.0, 2000.0, 0.0), "+proj=utm", "SUMO 1.16")


def test_ways_join_their_parts(streets: StreetMap) -> None:
    ahead, right = streets.ways["A_1>B_0"], streets.ways["A_1>C_0"]
    assert ahead.line[:, 0].tolist() == [100, 105, 110] and ahead.speed_m_s == 8
    assert (ahead.turn, right.turn, right.junction) == ("straight", "right", "J")
    assert (ahead.program, ahead.link, right.link) == ("J", 0, 1)
    assert streets.programs["J"].phases == ((20.0, "Ggr"), (5.0, "rrG")) and streets.programs["J"].offset_s == 3


def test_requests_say_who_yields(streets: StreetMap) -> None:
    junction = streets.junctions["J"]
    assert junction.yields == {("A_1>C_0", "A_1>B_0")} and junction.foes is not None
    assert ("A_1>B_0", "A_1>C_0") in junction.foes and junction.outline is not None and len(junction.outline) == 4


def test_crossings_have_their_light(streets: StreetMap) -> None:
    (crossing,) = streets.crossings
    assert (crossing.roads, crossing.width_m, crossing.program, crossing.link) == (("A",), 4.0, "J", 2)
    assert [area.kind for area in streets.areas] == ["walk"]


def test_left_hand_networks_count_lanes_from_the_left(tmp_path: Path) -> None:
    streets = read_map(written(tmp_path, SUMO.replace("<net ", '<net lefthand="true" '), "a.net.xml"))
    assert streets.left_hand and streets.lanes["A_1"].right == "A_2" and streets.lanes["A_1"].left is None


def test_polygons_beside_the_network_are_houses(tmp_path: Path) -> None:
    written(tmp_path, POLYGONS, "a.poly.xml.gz")
    streets = read_map(written(tmp_path, SUMO, "a.net.xml.gz"))
    (house,) = streets.solids
    assert (house.kind, house.height_m, len(house.line)) == ("building", 7.0, 4)
    assert Counter(area.kind for area in streets.areas) == {"walk": 1, "park": 1}
    assert streets.left_out == {"elements poi": 1, "polygons of type landuse": 1}


def test_without_lanes_in_junctions_a_way_is_straight(tmp_path: Path) -> None:
    text = "\n".join(line for line in SUMO.splitlines() if ":J" not in line or "junction" in line)
    text += '\n<connection from="A" to="B" fromLane="1" toLane="0" dir="s" state="M"/>\n</net>'
    way = read_map(written(tmp_path, text.replace("</net>\n", ""), "a.net.xml")).ways["A_1>B_0"]
    assert np.array_equal(way.line, [[100, -2, 0], [110, -2, 0]])
