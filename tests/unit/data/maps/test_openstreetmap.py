"""Maps of OpenStreetMap: what stands beside roads, what netconvert gets and says, and a network where it is there."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from tiny_maps import SUMO, written
from tiny_osm import BESIDE, CROSSROADS, STREETS, node, osm, way

from coopsim.data.maps import netconvert
from coopsim.data.maps.elements import read_elements
from coopsim.data.maps.osm.content import Content, Places, quantity
from coopsim.data.maps.osm.projection import Utm
from coopsim.data.maps.osm.reader import keeps_left
from coopsim.data.maps.osm.solids import Solids
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.errors import MapFileError, MapWarning, MissingDependencyError


def content_of(folder: Path, text: str) -> Content:
    elements = read_elements(written(folder, text, "a.osm"))
    return Content(next(elements), elements)


@pytest.mark.parametrize(
    ("lat", "lon", "zone", "east", "north"),
    [  # by PROJ 9
        (51.99627, 13.682992, Utm(33), 409581.08713, 5761442.26659),
        (43.642567, -79.387139, Utm(17), 630084.30083, 4833438.58567),
        (0.0, 0.0, Utm(31), 166021.44308, 0.0),
        (-45.0, -179.9, Utm(60, south=True), 744327.56653, 5012373.54348),
        (-33.86, 151.2, Utm(56, south=True), 333491.22993, 6251909.20605),
        (60.0, 12.0, Utm(31), 1000961.40452, 6685590.89353),
    ],
)
def test_utm_agrees_with_proj(lat: float, lon: float, zone: Utm, east: float, north: float) -> None:
    assert np.allclose(zone.metres(np.array([lat]), np.array([lon])), [[east, north]], rtol=0, atol=1e-4)
    assert Utm.of(zone.text) == zone and Utm.of("+proj=merc") is None


def test_zones_of_places() -> None:
    assert [Utm.around(*place).zone for place in ((0, 0), (48, 11.9), (-1, 180), (3, -180))] == [31, 32, 1, 1]
    assert Utm.around(-1, 0).south and not Utm.around(1, 0).south


def test_what_stands_beside_the_roads(tmp_path: Path) -> None:
    content = content_of(tmp_path, osm(BESIDE))
    beside = Solids(content, Places.projected(content, Utm(32), np.array([500_000.0, 5_316_300.22])))
    houses = {each.id: each for each in beside.solids if each.kind == "building"}
    assert {name: house.height_m for name, house in houses.items()} == {"a": 9.0, "b": 12.5, "j": pytest.approx(9.144)}
    assert np.allclose(houses["a"].line[:, :2], [[20, 20], [30, 20], [30, 30], [20, 30]], atol=0.02)
    assert len(houses["j"].line) == 4
    walls = {each.id: (each.height_m, each.thickness_m) for each in beside.solids if each.kind == "wall"}
    assert walls == {"k": (2.0, 0.25), "l": (None, 1.0)}
    trees = [each for each in beside.solids if each.kind == "tree"]
    assert len(trees) == 4 and trees[0].height_m == 7 and np.ptp(trees[0].line[:, 0]) == pytest.approx(6)
    assert [each.kind for each in beside.areas] == ["park", "walk"]
    assert content.notes.left_out == {"ways landuse": 1, "ways building": 2, "ways barrier": 1}


@pytest.mark.parametrize(("text", "number"), [("7", 7.0), ("7,5 m", 7.5), ("10 ft", 3.048), ("two", None), ("-3", None),
                                              ("0", None), ("1e9", None), ("12 floors", None)])  # fmt: skip
def test_tags_that_are_no_number_count_as_missing(text: str, number: float | None) -> None:
    assert quantity(text) == (None if number is None else pytest.approx(number))


@pytest.mark.parametrize(
    ("tags", "left"),
    [({"driving_side": "left", "addr:country": "DE"}, True), ({"addr:country": "gb"}, True), ({}, False),
     ({"addr:country": "DE"}, False), ({"driving_side": "right", "addr:country": "JP"}, False)],
)  # fmt: skip
def test_the_side_of_the_road_is_that_of_tags(tags: dict[str, str], left: bool, tmp_path: Path) -> None:
    assert keeps_left(content_of(tmp_path, osm(node("1", 0, 0), way("2", "1", tags)))) is left


def program(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Put a program of the name netconvert on the path, and nothing else."""
    path = folder / "netconvert"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    monkeypatch.setattr(netconvert, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}/usr/bin{os.pathsep}/bin")


def test_without_netconvert_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(netconvert, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingDependencyError, match=r"need netconvert of SUMO: pip install 'coopsim\[sumo\]'"):
        read_map(written(tmp_path, CROSSROADS, "a.osm"))


def test_netconvert_gets_roads_alone_and_its_warnings_are_condensed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, SUMO.replace("+proj=utm", "+proj=utm +zone=32"), "made.net.xml")
    words = ["Speed of '1' is 5.2.", "7 total messages of type: Speed of % is %.", "Lost edge 'x'.", "Lost edge 'y'."]
    (tmp_path / "words").write_text("Success.\n" + "".join(f"Warning: {each}\n" for each in words))
    program(tmp_path, monkeypatch, f'''while [ $# -gt 1 ]; do case "$1" in --osm-files) cp "$2" {tmp_path}/got.osm;;
--output-file) cp {tmp_path}/made.net.xml "$2";; --lefthand) echo "$2" > {tmp_path}/side;; esac; shift 2; done
cat {tmp_path}/words >&2''')  # fmt: skip
    with pytest.warns(MapWarning):
        streets = read_map(written(tmp_path, CROSSROADS, "a.osm"))
    assert streets.format == "OpenStreetMap 0.6, by SUMO 1.16" and streets.source.endswith("a.osm")
    assert streets.repaired == ("netconvert: Speed of % is %: 7", "netconvert: Lost edge %: 1")
    assert {each.kind for each in streets.solids} == {"building", "wall", "tree", "pole"}
    assert streets.left_out["ways highway on yards"] == 1 and (tmp_path / "side").read_text() == "false\n"
    got = ET.parse(tmp_path / "got.osm").getroot()
    assert [(each.tag, each.get("id")) for each in got] == [
        *(("node", each) for each in "126345"), *(("way", each) for each in ("10", "14", "11", "15")),
        ("relation", "30"),
    ]  # fmt: skip
    assert {"k": "name", "v": 'A <b> & "c"'} in [tag.attrib for tag in got.iter("tag")]


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("echo 'Error: No nodes loaded.' >&2; exit 1", r"makes no network of this map \(No nodes loaded"),
        ("kill -9 $$", r"makes no network of this map \(it ended with -9\); accepted"),
        ("exit 0", "makes no network of this map"),
        ("sleep 5", "netconvert took more than 0.2 s; accepted: a smaller extract"),
    ],
)
def test_failures_of_netconvert_are_one_line(
    script: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(netconvert, "LONGEST_S", 0.2 if "sleep" in script else 20.0)
    program(tmp_path, monkeypatch, f"exec {script}" if "sleep" in script else script)
    with pytest.raises(MapFileError, match=told) as caught:
        read_map(written(tmp_path, osm(STREETS), "a.osm"))
    assert "\n" not in str(caught.value) and "a.osm" in str(caught.value)


def test_a_program_that_cannot_run_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(tmp_path, monkeypatch, "")
    (tmp_path / "netconvert").write_text("#!/nowhere/sh\n")
    with pytest.raises(MapFileError, match=r"cannot run .*netconvert"):
        read_map(written(tmp_path, osm(STREETS), "a.osm"))


@pytest.fixture(scope="module")
def crossroads(tmp_path_factory: pytest.TempPathFactory) -> StreetMap:
    if not netconvert.is_there():
        pytest.skip("needs netconvert of SUMO: pip install 'coopsim[sumo]'")
    return read_map(written(tmp_path_factory.mktemp("maps"), CROSSROADS, "a.osm"))


def test_a_crossroads_has_lanes_lights_and_crossings(crossroads: StreetMap) -> None:
    kinds = Counter(lane.kind for lane in crossroads.lanes.values())
    assert kinds["drive"] >= 8 and kinds["walk"] >= 4 and len(crossroads.crossings) >= 2
    turns = Counter(way.turn for way in crossroads.ways.values() if way.junction == "2")
    assert turns["straight"] == 4 and turns["left"] == 3 and turns["right"] == 4  # one left turn is forbidden
    assert {way.program for way in crossroads.ways.values() if way.junction == "2"} == {"2"}
    assert {round(lane.speed_m_s * 3.6) for lane in crossroads.lanes.values() if lane.kind == "drive"} == {30, 50}


def test_houses_lie_where_the_roads_are(crossroads: StreetMap) -> None:
    """The corner of the square (20, 20) is as far from the middle of the junction in the map as in the file."""
    outline = crossroads.junctions["2"].outline
    assert outline is not None
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    house = next(each for each in crossroads.solids if each.id == "a")
    assert np.allclose(house.line[0, :2] - middle, [20, 20], atol=0.5)
    assert Utm.of(crossroads.projection) == Utm(32)


def test_left_hand_countries_keep_to_the_left(tmp_path: Path) -> None:
    if not netconvert.is_there():
        pytest.skip("needs netconvert of SUMO: pip install 'coopsim[sumo]'")
    text = CROSSROADS.replace('k="natural" v="tree"/>', 'k="natural" v="tree"/><tag k="addr:country" v="GB"/>', 1)
    assert read_map(written(tmp_path, text, "a.osm")).left_hand
