"""Maps of others, where the user has them: each loads, quickly, and lanes agree with an independent reading."""

from __future__ import annotations

import gzip
import math
import os
import time
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from coopsim.data.maps import netconvert
from coopsim.data.maps.check import check_map, driven_lanes
from coopsim.data.maps.place.carla_routes import read_routes, start_on
from coopsim.data.maps.place.cut import cut_out
from coopsim.data.maps.place.describe import describe_place
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.errors import MapWarning
from coopsim.geometry.se3 import Floats
from coopsim.world.custom.place import place_from


@pytest.fixture
def maps() -> Path:
    path = Path(os.environ.get("COOPSIM_DATA", "")) / "maps"
    if "COOPSIM_DATA" not in os.environ or not path.is_dir():
        pytest.skip("needs maps: set COOPSIM_DATA to a folder that contains maps with opendrive, sumo and lanelet2")
    return path


def read(path: Path) -> StreetMap:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)
        return read_map(path)


def widest_gap_m(streets: StreetMap) -> float:
    """Return the widest gap between lanes and ways that lead on to each other."""
    lanes, ways = streets.lanes, streets.ways.values()
    ends = [(lanes[start].line[-1], lanes[end].line[0]) for start, after in streets.links.items() for end in after]
    ends += [pair for way in ways for pair in ((lanes[way.start].line[-1], way.line[0]),
                                               (way.line[-1], lanes[way.end].line[0]))]  # fmt: skip
    return max((float(np.linalg.norm(first - second)) for first, second in ends), default=0.0)


def test_every_small_map_loads(maps: Path) -> None:
    files = [*sorted((maps / "opendrive" / "esmini").glob("*.xodr")), *sorted((maps / "sumo").glob("*.net.xml"))]
    assert len(files) > 30
    for file in files:
        streets = read(file)
        assert driven_lanes(streets) and all(np.isfinite(lane.line).all() for lane in streets.lanes.values()), file
        assert streets.format.startswith("SUMO") or widest_gap_m(streets) < 0.01, file


@pytest.mark.parametrize(("town", "lanes", "ways"), [("Town01", 52, 72), ("Town03", 172, 224), ("Town05", 218, 268)])
def test_a_town_of_carla_hangs_together(town: str, lanes: int, ways: int, maps: Path) -> None:
    read(maps / "opendrive" / "esmini" / "straight_road.xodr")  # kernels are compiled once
    start = time.process_time()
    streets = read(maps / "opendrive" / f"{town}.xodr.gz")
    assert time.process_time() - start < 5.0
    check = check_map(streets)
    assert (len(check.lanes), len(streets.ways)) == (lanes, ways)
    assert not check.unreached and not check.unleft and len(check.joined) == lanes
    assert widest_gap_m(streets) < 0.002


def test_a_route_of_carla_lies_on_the_lanes_of_town05(maps: Path, tmp_path: Path) -> None:
    marks = '<waypoint x="-107.2" y="-135.2" z="0"/><waypoint x="-55.8" y="-107.1" z="0"/>'
    file = tmp_path / "routes.xml"
    file.write_text(f'<routes><route id="100" town="Town05">{marks}</route></routes>')
    town = read(maps / "opendrive" / "Town05.xodr.gz")
    (route,) = read_routes(file)
    layout = place_from(describe_place(cut_out(town, route.around, 100.0), 0), "town").make_layout()
    started, length_m = start_on(layout, route, route.around)
    place = layout.network.get_lane(started.slots[0].lane).position(started.slots[0].along_m, 0.0)
    assert np.hypot(*(place + route.around - route.points[0])) < 1.0
    assert length_m == pytest.approx(64.4, abs=1.0)


@pytest.mark.long
@pytest.mark.heavy("reads a town of 700 km")
@pytest.mark.parametrize(("town", "limit_s"), [("Town02", 5.0), ("Town04", 5.0), ("Town06", 5.0), ("Town11", 20.0)])
def test_the_other_towns_of_carla_load_in_time(town: str, limit_s: float, maps: Path) -> None:
    read(maps / "opendrive" / "esmini" / "straight_road.xodr")
    start = time.process_time()
    streets = read(maps / "opendrive" / f"{town}.xodr.gz")
    assert time.process_time() - start < limit_s
    assert widest_gap_m(streets) < 0.01 and len(check_map(streets).joined) > 0.99 * len(driven_lanes(streets))


def dense(line: Floats, step_m: float) -> Floats:
    """Return points (K, 2) along a line, `step_m` apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    wanted = np.arange(0.0, along[-1], step_m)
    return np.column_stack([np.interp(wanted, along, line[:, axis]) for axis in (0, 1)])


def lanelets(path: Path) -> list[Floats]:
    """Return middles (K, 2) of the lanelets of a file, in the axes of OpenDRIVE.

    The file has degrees of UTM's zone 31 around (0, 0), 3 degrees from its middle, and CARLA's y, which points south.
    """
    root = ET.fromstring(gzip.decompress(path.read_bytes()))
    scale = 0.9996 * (1 + math.radians(3) ** 2 / 2)
    east_m, north_m = 6_378_137.0 * scale, 6_335_439.3 * scale
    nodes = {
        each.get("id"): (math.radians(float(each.get("lon", ""))) * east_m,
                         -math.radians(float(each.get("lat", ""))) * north_m)
        for each in root.iter("node")
    }  # fmt: skip
    ways = {each.get("id"): np.array([nodes[nd.get("ref")] for nd in each.iter("nd")]) for each in root.iter("way")}
    found = []
    for relation in root.iter("relation"):
        if {"k": "type", "v": "lanelet"} in [tag.attrib for tag in relation.iter("tag")]:
            sides = {each.get("role"): ways[each.get("ref")] for each in relation.iter("member")
                     if each.get("type") == "way"}  # fmt: skip
            found.append((sides["left"] + sides["right"]) / 2)
    return found


@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_lanes_agree_with_lanelets(town: str, maps: Path) -> None:
    """Both ways: no lane of one reading is missing in the other, and lengths agree."""
    streets = read(maps / "opendrive" / f"{town}.xodr.gz")
    ours = [lane.line for lane in driven_lanes(streets)] + [way.line for way in streets.ways.values()]
    theirs = lanelets(maps / "lanelet2" / f"{town}.osm.gz")
    assert len(ours) == len(theirs)
    for first, second in ((ours, theirs), (theirs, ours)):
        tree = KDTree(np.concatenate([dense(line, 0.1) for line in first]))
        apart, _ = tree.query(np.concatenate([dense(line, 1.0) for line in second]))
        assert np.quantile(apart, 0.99) < 0.1
    lengths = [sum(np.hypot(*np.diff(line[:, :2], axis=0).T).sum() for line in lines) for lines in (ours, theirs)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.002)


@pytest.mark.parametrize("town", ["Town01", "Town02"])
def test_our_lanelets_agree_with_our_roads(town: str, maps: Path) -> None:
    """Lanes, ways, turns and lights of one town from two formats."""
    roads, lanelets_ = read(maps / "opendrive" / f"{town}.xodr.gz"), read(maps / "lanelet2" / f"{town}.osm.gz")
    lines = [[each.line for each in (*driven_lanes(one), *one.ways.values())] for one in (roads, lanelets_)]
    for first, second in (lines, lines[::-1]):
        tree = KDTree(np.concatenate([dense(line, 0.1) for line in first]))
        apart, _ = tree.query(np.concatenate([dense(line, 1.0) for line in second]))
        assert np.quantile(apart, 0.99) < 0.01 and apart.max() < 0.05
    for count in (lambda one: len(driven_lanes(one)), lambda one: sorted(way.turn for way in one.ways.values()),
                  lambda one: len(one.junctions), lambda one: len(one.signals), lambda one: one.left_hand):  # fmt: skip
        assert count(roads) == count(lanelets_)
    assert widest_gap_m(lanelets_) < 0.05 and len(check_map(lanelets_).joined) == len(driven_lanes(lanelets_))
    assert all(len(light.lanes) == 1 for light in lanelets_.signals)


def test_a_race_track_of_openstreetmap_is_read(maps: Path) -> None:
    if not netconvert.is_there():
        pytest.skip("needs netconvert of SUMO: pip install 'coopsim[sumo]'")
    streets = read(maps / "spreewaldring.osm")
    length_m = sum(lane.length_m for lane in driven_lanes(streets))
    assert length_m == pytest.approx(4580, rel=0.02) and len(streets.solids) == 15
