"""Demand of SUMO: what departs, where it goes, and what that makes on lanes and ways."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny_maps import SUMO, written

from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.data.maps.sumo.demand import with_demand
from coopsim.errors import MapFileError


@pytest.fixture
def streets(tmp_path: Path) -> StreetMap:
    return read_map(written(tmp_path, SUMO, "a.net.xml"))


def told(streets: StreetMap, folder: Path, text: str, *times_s: float) -> tuple[dict[str, float | None], StreetMap]:
    path = written(folder, f"<routes>{text}</routes>", "a.rou.xml")
    found = with_demand(streets, path, *times_s)
    parts = (*found.lanes.values(), *found.ways.values())
    return {each.id: each.traffic_per_h for each in parts}, found


def test_trips_vehicles_and_flows_are_counted_in_an_hour(streets: StreetMap, tmp_path: Path) -> None:
    text = """<vType id="car" vClass="passenger"/><vType id="bike" vClass="bicycle"/><route id="r" edges="A C"/>
        <trip id="1" depart="0" from="A" to="B"/><trip id="2" depart="0:30:00" type="car" from="A" to="C"/>
        <vehicle id="3" depart="3600" route="r"/><vehicle id="4" depart="60"><route edges="A B"/></vehicle>
        <flow id="5" begin="0" end="3600" vehsPerHour="20" from="A" to="B"/>
        <flow id="6" begin="0" end="1800" period="180" from="A" to="C"/>
        <flow id="7" end="3600" number="7" from="B" to="B"/>
        <trip id="8" depart="9" type="bike" from="A" to="B"/><person id="9" depart="0"/>"""
    rates, found = told(streets, tmp_path, text)
    assert rates == {
        "A_0": None, "A_1": 34, "A_2": 0, "B_0": 29, "C_0": 12, "A_1>B_0": 22, "A_1>C_0": 12,
    }  # fmt: skip
    assert found.left_out["elements person of the demand"] == 1
    assert found.left_out["vehicles of the demand that are no motor vehicles"] == 1


def test_a_part_of_the_time_counts(streets: StreetMap, tmp_path: Path) -> None:
    text = """<trip id="1" depart="100" from="A" to="B"/><trip id="2" depart="2000" from="A" to="C"/>
        <flow id="3" begin="900" end="2700" number="60" from="A" to="C"/>"""
    rates, _ = told(streets, tmp_path, text, 0, 1800)
    assert rates["A_1>B_0"] == 2 and rates["A_1>C_0"] == 60


def test_a_trip_takes_the_quickest_way(tmp_path: Path) -> None:
    """Over the edge that is as long, but faster."""
    edge = '<edge id="{}" from="{}" to="{}"><lane id="{}_0" index="0" speed="{}" shape="{}"/></edge>'
    edges = [("a", "1", "2", 10, "0,0 50,0"), ("slow", "2", "3", 5, "50,0 99,0"),
             ("fast", "2", "3", 9, "50,0 75,9 99,0"), ("z", "3", "4", 10, "99,0 150,0")]  # fmt: skip
    links = "".join(f'<connection from="{one}" to="{two}" fromLane="0" toLane="0"/>'
                    for one, two in (("a", "slow"), ("a", "fast"), ("slow", "z"), ("fast", "z")))  # fmt: skip
    text = "".join(edge.format(name, one, two, name, speed, shape) for name, one, two, speed, shape in edges)
    streets = read_map(written(tmp_path, f"<net>{text}{links}</net>", "b.net.xml"))
    rates, _ = told(streets, tmp_path, '<trip id="1" depart="0" from="a" to="z"/><flow id="2" end="3600" number="0"/>')
    assert rates == {"a_0": 1, "slow_0": 0, "fast_0": 1, "z_0": 1}
    rates, _ = told(streets, tmp_path, '<trip id="1" depart="0" from="a" via="slow" to="z"/>', 0, 3600)
    assert rates == {"a_0": 1, "slow_0": 1, "fast_0": 0, "z_0": 1}


def test_vehicles_without_a_way_are_left_out(streets: StreetMap, tmp_path: Path) -> None:
    text = '<trip id="1" depart="0" from="B" to="A"/><trip id="2" depart="3600" from="A" to="X"/>'
    _, found = told(streets, tmp_path, text + '<trip id="3" depart="9" from="A" to="B"/>')
    assert found.repaired == ("vehicles of the demand without a way on the map are left out: 2 (line 1, line 1)",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<routes/>", "<routes> has no vehicle that departs from 0 to 0 s and has a way on the map"),
        ("<net/>", "<net> is no demand of SUMO; accepted: a file of <routes>"),
        ('<routes><trip id="1" depart="nan" from="A" to="B"/></routes>', "<trip id='1'> depart must be a number"),
        ('<routes><trip id="1" depart="1:x:3" from="A" to="B"/></routes>', "<trip> m must be a number"),
        ('<routes><trip id="1" from="A" to="B"/></routes>', "<trip id='1'> must have the attribute depart"),
        ('<routes><flow id="1" from="A" to="B"/></routes>', "<flow id='1'> must have one of number, period in seconds"),
        ("<routes><trip", "cut off"),
    ],
)  # fmt: skip
def test_a_damaged_demand_is_one_line(text: str, message: str, streets: StreetMap, tmp_path: Path) -> None:
    path = written(tmp_path, text, "a.rou.xml")
    with pytest.raises(MapFileError, match=message) as caught:
        with_demand(streets, path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
