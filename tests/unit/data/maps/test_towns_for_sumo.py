"""Drawn towns as networks of SUMO: plain XML that fits together, and networks that netconvert makes of it."""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from representatives import all_of
from test_exported_towns import away_m, lane_points, lit, town_of, ways_by_place

from coopsim.data.maps.export.sumo.network import plain_files, polygons_text, sumo_files
from coopsim.data.maps.netconvert import is_there
from coopsim.data.maps.reading import read_map

SEEDS = all_of(map(str, range(10)), "2", "3")


@lru_cache
def plain(seed: int) -> dict[str, ElementTree.Element]:
    return {name: ElementTree.fromstring(text) for name, text in plain_files(town_of(seed)).items()}


def shape(element: ElementTree.Element) -> np.ndarray:
    return np.array([[float(value) for value in point.split(",")] for point in element.attrib["shape"].split()])


@pytest.mark.parametrize("seed", SEEDS)
def test_connections_begin_and_end_at_lanes(seed: str) -> None:
    files = plain(int(seed))
    nodes = {node.attrib["id"] for node in files["node-files"]}
    edges = [edge for edge in files["edge-files"] if edge.tag == "edge"]
    lanes = {(edge.attrib["id"], lane.attrib["index"]): shape(lane) for edge in edges for lane in edge}
    ends = {edge.attrib["id"]: (edge.attrib["from"], edge.attrib["to"]) for edge in edges}
    assert {node for pair in ends.values() for node in pair} == nodes
    left, reached = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for each in files["connection-files"]:
        if each.tag == "connection":
            start, end = ((each.attrib[key], each.attrib[f"{key}Lane"]) for key in ("from", "to"))
            line = shape(each)
            assert np.abs(line[0] - lanes[start][-1]).max() < 0.03 and np.abs(line[-1] - lanes[end][0]).max() < 0.03
            assert ends[start[0]][1] == ends[end[0]][0]
            left[start] += 1
            reached[end] += 1
    driven = {lane for lane in lanes if lane[1] != "0"}
    assert set(left) == set(reached) == driven, "each lane for vehicles is left and reached"


def test_middles_of_lanes_are_the_towns() -> None:
    for seed in (2, 3):
        lines = [shape(each) for name in ("edge-files", "connection-files") for each in plain(seed)[name].iter()
                 if each.tag in ("lane", "connection") and each.get("allow") is None]  # fmt: skip
        assert away_m(lane_points(town_of(seed), tapers=True), lines).max() < 0.02


def test_programs_of_lights_are_written_with_their_links() -> None:
    town = lit(town_of(2))
    files = plain_files(town)
    lights = ElementTree.fromstring(files["tllogic-files"])
    program, links = lights.find("tlLogic"), lights.findall("connection")
    assert program is not None and program.attrib["offset"] == "3.0"
    assert [(each.attrib["duration"], each.attrib["state"]) for each in program] == [
        (str(phase.seconds), phase.state) for phase in town.description.signals[0].phases
    ]
    assert sorted(int(each.attrib["linkIndex"]) for each in links) == list(range(len(town.junctions["j0"])))
    node = ElementTree.fromstring(files["node-files"]).find("node[@id='j0']")
    assert node is not None and (node.attrib["type"], node.attrib["tl"]) == ("traffic_light", "lights0")


def test_polygons_are_houses_walls_and_bays(tmp_path: Path) -> None:
    town = town_of(2)
    polygons = ElementTree.fromstring(polygons_text(town))
    kinds = Counter(each.attrib["type"] for each in polygons)
    assert kinds["building"] == len(town.description.buildings) and kinds["barrier"] > 0
    assert kinds["amenity.parking"] == len(town.description.parked)


@pytest.mark.skipif(not is_there(), reason="netconvert is not installed: pip install eclipse-sumo")
@pytest.mark.parametrize("seed", SEEDS)
def test_networks_come_back(seed: str, tmp_path: Path) -> None:
    town = lit(town_of(int(seed)))
    for path, text in sumo_files(town, tmp_path / "town.net.xml").items():
        path.write_text(text, encoding="utf-8")
    streets = read_map(tmp_path / "town.net.xml")
    drive = [lane.line for lane in streets.lanes.values() if lane.kind == "drive"]
    drive += [way.line for way in streets.ways.values()]
    assert away_m(lane_points(town, tapers=True), drive).max() < 0.02
    found = ways_by_place(town, streets, 0.3)  # netconvert shortens some at waiting places
    for way in town.ways:
        assert away_m(way.line, [found[way.road].line]).max() < 0.02
    yields = {pair for each in streets.junctions.values() for pair in each.yields or ()}
    for name in set(town.junctions) - {"j0"}:
        for first, other in town.first_ways(name):
            assert (found[other.road].id, found[first.road].id) in yields
            assert (found[first.road].id, found[other.road].id) not in yields
    assert town.description.walks is not None
    assert len(streets.crossings) == len(town.description.walks.crosswalks)
    links = {found[way.road].link for way in town.junctions["j0"]}
    assert streets.programs["lights0"].offset_s == 3.0 and links == set(range(len(town.junctions["j0"])))
    assert len([solid for solid in streets.solids if solid.kind == "building"]) == len(town.description.buildings)
