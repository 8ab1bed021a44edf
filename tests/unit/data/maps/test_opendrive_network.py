"""Links, ways over junctions, signals and objects of a small map of three roads."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from tiny_maps import ARMS, JUNCTION, QUARTER, THREE_ROADS, lane, lanes, opendrive, piece, road, to, written

from coopsim.data.maps.check import check_map, describe_map
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.errors import MapWarning


@pytest.fixture
def streets(tmp_path: Path) -> StreetMap:
    return read_map(written(tmp_path, THREE_ROADS, "map.xodr.gz"))


def test_ways_lead_over_the_junction(streets: StreetMap) -> None:
    assert set(streets.ways) == {"1.0.-1>2.0.-1", "1.0.-1>3.0.-1", "2.0.1>1.0.1"}
    ahead, right, back = (streets.ways[name] for name in ("1.0.-1>2.0.-1", "1.0.-1>3.0.-1", "2.0.1>1.0.1"))
    assert (ahead.turn, right.turn, back.turn) == ("straight", "right", "straight")
    assert ahead.line[0] == pytest.approx([100, -1.75, 0]) and ahead.line[-1] == pytest.approx([120, -1.75, 0])
    assert back.line[0] == pytest.approx([120, 1.75, 0]) and back.junction == "9"
    assert right.length_m == pytest.approx((10 - 1.75) * math.pi / 2, rel=1e-3)
    assert right.line[-1] == pytest.approx(streets.lanes["3.0.-1"].line[0], abs=1e-9)
    assert streets.junctions["9"].yields == {("1.0.-1>3.0.-1", "1.0.-1>2.0.-1"), ("1.0.-1>3.0.-1", "2.0.1>1.0.1")}


def test_header_and_format_are_kept(streets: StreetMap) -> None:
    assert (streets.format, streets.offset_m, streets.projection) == ("OpenDRIVE 1.6", (1.0, 2.0, 3.0), "+proj=tmerc")
    assert streets.left_out == {"objects of type patch": 1} and streets.repaired == ()


def test_signals_hold_for_lanes_that_go_their_way(streets: StreetMap) -> None:
    (light,) = streets.signals
    assert (light.kind, light.lanes, light.controller) == ("light", ("1.0.-1",), "7")
    assert light.at == pytest.approx([95, -4, 2]) and light.code == "OpenDRIVE:1000001:-1"
    held = {name: way.signals for name, way in streets.ways.items()}
    assert held == {"1.0.-1>2.0.-1": ("5",), "1.0.-1>3.0.-1": ("5",), "2.0.1>1.0.1": ()}


def test_objects_stand_where_they_are(streets: StreetMap) -> None:
    (crossing,) = streets.crossings
    assert sorted(crossing.line[:, 1].tolist()) == pytest.approx([-3.5, 3.5]) and crossing.width_m == pytest.approx(3)
    assert np.allclose(crossing.line[:, 0], 90) and crossing.roads == ("1",)
    assert Counter(each.kind for each in streets.solids) == {"building": 1, "tree": 1, "wall": 1, "pole": 5}
    house = next(each for each in streets.solids if each.kind == "building")
    low, high = house.line.min(axis=0), house.line.max(axis=0)
    assert low == pytest.approx([24, 11, 0]) and high == pytest.approx([36, 19, 0]) and house.height_m == 9
    wall = next(each for each in streets.solids if each.kind == "wall")
    assert wall.line[0] == pytest.approx([10, -6, 0]) and wall.line[-1] == pytest.approx([30, -7, 0])
    assert wall.thickness_m == pytest.approx(0.3) and wall.height_m == 1
    poles = [each.line.mean(axis=0) for each in streets.solids if each.kind == "pole"]
    assert np.array(poles)[:, 0] == pytest.approx([10, 15, 20, 25, 30])


def test_lanes_without_a_way_are_told(streets: StreetMap) -> None:
    check = check_map(streets)
    assert (check.unreached, check.unleft) == (("1.0.-1", "2.0.1", "3.0.1"), ("1.0.1", "2.0.-1", "3.0.1", "3.0.-1"))
    told = "\n".join(describe_map(streets))
    assert "lanes: 6 driven, 0.50 km" in told and "1 right, 2 straight" in told and "1 objects of type patch" in told


def test_a_road_in_two_pieces_leads_on_without_a_junction(tmp_path: Path) -> None:
    first = road("a", piece(0, 0.0, 0.0, 0.0, 10.0), lanes(lane(1, after="-1"), lane(-1, after="1")),
                 link=to("successor", "b", "end"))  # fmt: skip
    turned = road("b", piece(0, 30.0, 0.0, math.pi, 20.0), lanes(lane(1, after="-1"), lane(-1, after="1")),
                  link=to("successor", "a", "end"))  # fmt: skip
    found = read_map(written(tmp_path, opendrive(first, turned)))
    assert found.links == {"a.0.-1": ("b.0.1",), "b.0.-1": ("a.0.1",)}


def test_a_direct_junction_joins_lanes_themselves(tmp_path: Path) -> None:
    direct = JUNCTION.replace('id="9"', 'id="9" type="direct"').replace("connectingRoad", "linkedRoad")
    one = road("1", piece(0, 0.0, 0.0, 0.0, 100.0), lanes("", lane(-1)), link=to("successor", "9"))
    two = road("10", piece(0, 100.0, 0.0, 0.0, 20.0), lanes("", lane(-1)), link=to("predecessor", "9"))
    with pytest.warns(MapWarning, match="connections of roads that do not exist are passed over: 2"):
        found = read_map(written(tmp_path, opendrive(one, two, direct)))
    assert found.links == {"1.0.-1": ("10.0.-1",)} and not found.ways and found.junctions["9"].kind == "direct"


def test_virtual_junctions_are_named_and_their_main_road_goes_on(tmp_path: Path) -> None:
    virtual = opendrive(*ARMS).replace("</OpenDRIVE>", JUNCTION.replace('id="9"', 'id="9" type="virtual"'))
    found = read_map(written(tmp_path, virtual + "</OpenDRIVE>"))
    assert found.left_out["connections of virtual junctions"] == 3 and not found.ways
    assert found.links == {"10.0.1": ("1.0.1",), "10.0.-1": ("2.0.-1",), "11.0.-1": ("3.0.-1",),
                           "1.0.-1": ("10.0.-1", "11.0.-1"), "2.0.1": ("10.0.1",)}  # fmt: skip


def test_pieces_too_short_to_drive_on_are_joined(tmp_path: Path) -> None:
    sections = "".join(
        f'<laneSection s="{s}"><center/><right>{lane(-1, "-1", "-1")}</right></laneSection>' for s in (0, 50, 50.05)
    )
    text = opendrive(road("1", piece(0, 0.0, 0.0, 0.0, 100.0), f"<lanes>{sections}</lanes>"))
    with pytest.warns(MapWarning, match="lanes shorter than 0.1 m are joined to the next one: 1"):
        found = read_map(written(tmp_path, text))
    assert found.links == {"1.0.-1": ("1.2.-1",)} and set(found.lanes) == {"1.0.-1", "1.2.-1"}


def test_a_way_may_cross_several_connecting_roads(tmp_path: Path) -> None:
    half = road("11b", piece(0, 110.0, -10.0, -math.pi / 2, 5.0), lanes("", lane(-1, "-1", "-1")), junction="9",
                link=to("predecessor", "11", "end") + to("successor", "3", "start"))  # fmt: skip
    arms = list(ARMS)
    arms[2] = arms[2].replace('y="-10.0"', 'y="-15.0"')
    arms[4] = arms[4].replace('elementId="3"', 'elementId="11b"')
    way = read_map(written(tmp_path, opendrive(*arms, half, JUNCTION))).ways["1.0.-1>3.0.-1"]
    assert way.length_m == pytest.approx((10 - 1.75) * QUARTER / 10 + 5, rel=1e-3)
