"""Drawn towns as OpenDRIVE come back through our own reader: lanes, ways, who goes first, lights, what stands there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from representatives import all_of

from coopsim.data.maps.export.opendrive.document import opendrive_text
from coopsim.data.maps.export.town_network import TownNetwork, town_network
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap, StreetWay
from coopsim.geometry.outlines import distances_to_lines
from coopsim.geometry.se3 import Floats
from coopsim.world.custom.conflicts import middle_line
from coopsim.world.drawn_options import TownOptions
from coopsim.world.places.description import MapPhase, MapSignal

SEEDS = all_of(map(str, range(10)), "2", "3")
"""Seed 2 has a roundabout, seed 3 streets whose lanes split and join."""

NEAR_M = 0.1
CHECKER = os.environ.get("COOPSIM_QC_OPENDRIVE") or shutil.which("qc_opendrive") or ""


@lru_cache
def town_of(seed: int) -> TownNetwork:
    return town_network(seed, TownOptions())


@lru_cache
def reread(town: TownNetwork) -> StreetMap:
    with TemporaryDirectory() as folder:
        path = Path(folder, "town.xodr")
        path.write_text(opendrive_text(town), encoding="utf-8")
        return read_map(path)


def test_a_town_on_the_left_is_that_on_the_right_in_a_mirror() -> None:
    right, left = reread(town_of(3)), reread(town_network(3, TownOptions(traffic_side="left")))
    assert (right.left_hand, left.left_hand) == (False, True)
    ends = [
        np.sort([lane.line[[0, -1], :2].ravel() * sign for lane in streets.lanes.values() if lane.kind == "drive"], 0)
        for streets, sign in ((right, 1.0), (left, np.array([1.0, -1.0, 1.0, -1.0])))
    ]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


def away_m(points: Floats, lines: Iterable[Floats]) -> Floats:
    """Return the distances (N,) of points from the nearest of lines."""
    lines = [line[:, :2] for line in lines]
    starts, ends = (np.concatenate([line[part] for line in lines]) for part in (slice(-1), slice(1, None)))
    return distances_to_lines(points, np.ascontiguousarray(starts), np.ascontiguousarray(ends), np.zeros(len(starts)))


def lane_points(town: TownNetwork, *, tapers: bool = False) -> Floats:
    """Return places (N, 2) m in the middle of lanes outside junctions; `tapers`: also where one splits off or joins."""
    ways = {piece for way in town.ways for piece in way.lanes}
    return np.concatenate(
        [
            middle_line(lane)
            for (start, end, _), lane in town.lanes.lanes.items()
            # A lane that splits off is named for another lane at its end: `s3f0.2` to `s3f1.0`.
            if lane not in ways and (tapers or start[0] == "j" or start.partition(".")[0] == end.partition(".")[0])
        ]
    )


def ways_by_place(town: TownNetwork, streets: StreetMap, within_m: float = NEAR_M) -> dict[tuple[str, str], StreetWay]:
    """Return what was read of each way: the one with the same ends."""
    ends = {name: np.concatenate([way.line[0, :2], way.line[-1, :2]]) for name, way in streets.ways.items()}
    found = {}
    for way in town.ways:
        own = np.concatenate([way.line[0], way.line[-1]])
        name = min(ends, key=lambda name: float(np.abs(ends[name] - own).max()))
        assert np.abs(ends[name] - own).max() < within_m
        found[way.road] = streets.ways[name]
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_lanes_and_ways_come_back_where_they_were(seed: str) -> None:
    town = town_of(int(seed))
    streets = reread(town)
    assert streets.repaired == () and set(streets.left_out) <= {"objects of type obstacle"}
    drive = [lane.line for lane in streets.lanes.values() if lane.kind == "drive"]
    assert away_m(lane_points(town), drive).max() < NEAR_M
    found = ways_by_place(town, streets)
    assert len({way.id for way in found.values()}) == len(town.ways) == len(streets.ways)
    for way in town.ways:
        assert away_m(way.line, [found[way.road].line]).max() < NEAR_M
        assert found[way.road].speed_m_s == pytest.approx(way.lanes[0].speed_limit)


@pytest.mark.parametrize("seed", SEEDS)
def test_lanes_lead_on_as_in_the_town(seed: str) -> None:
    town = town_of(int(seed))
    streets = reread(town)
    found = ways_by_place(town, streets)
    starts, ends = ({way.road: getattr(found[way.road], end) for way in town.ways} for end in ("start", "end"))
    for one in town.ways:
        for other in town.ways:
            assert (starts[one.road] == starts[other.road]) == (one.start == other.start)
            assert (ends[one.road] == ends[other.road]) == (one.end == other.end)
    for way in found.values():
        for lane, joint in ((way.start, way.line[0]), (way.end, way.line[-1])):
            line = streets.lanes[lane].line
            assert min(np.linalg.norm(line[[0, -1]] - joint, axis=1)) < 0.01
            assert away_m(joint[None, :2], [line]) < 0.01


@pytest.mark.parametrize("seed", SEEDS)
def test_who_gives_way_comes_back(seed: str) -> None:
    town = town_of(int(seed))
    streets = reread(town)
    found = ways_by_place(town, streets)
    wanted = {(found[b.road].id, found[a.road].id) for name in town.junctions for a, b in town.first_ways(name)}
    assert wanted == {pair for each in streets.junctions.values() for pair in each.yields or ()}
    yielding = {signal.id for signal in streets.signals if signal.kind == "yield"}
    assert bool(yielding) == bool(wanted)


def test_what_stands_beside_the_lanes_comes_back() -> None:
    town = town_of(2)
    streets, description = reread(town), town.description
    houses = [solid for solid in streets.solids if solid.kind == "building"]
    for house, given in zip(sorted(houses, key=_west), sorted(description.buildings, key=_outline_west), strict=True):
        assert house.height_m == pytest.approx(given.height_m)
        assert np.abs(house.line[:, :2] - np.array(given.outline)).max() < 1e-3
    trees = np.array([piece.at for piece in description.furniture or () if piece.kind == "tree"])
    round_ = [solid.line[:, :2] for solid in streets.solids if solid.kind == "tree" and len(solid.line) == 12]
    read = np.array([line.mean(axis=0) for line in round_])
    assert len(trees) == len(read) > 50
    assert np.linalg.norm(trees[:, None] - read, axis=2).min(axis=1).max() < 0.01
    assert description.walks is not None
    assert len(streets.crossings) == len(description.walks.crosswalks)
    assert sum(area.kind == "park" for area in streets.areas) == len(description.parked)


def _west(solid: object) -> tuple[float, float]:
    x, y, _ = solid.line.min(axis=0).round(2).tolist()  # type: ignore[attr-defined]
    return x, y


def _outline_west(building: object) -> tuple[float, float]:
    x, y = np.array(building.outline).min(axis=0).round(2).tolist()  # type: ignore[attr-defined]
    return x, y


def test_pavements_have_the_height_of_kerbs() -> None:
    streets = reread(town_of(2))
    walks = [lane for lane in streets.lanes.values() if lane.kind == "walk"]
    assert walks and all(lane.line[:, 2] == pytest.approx(0.12) for lane in walks)
    walked = np.array(list(town_of(2).description.walks.nodes.values()))  # type: ignore[union-attr]
    assert np.quantile(away_m(walked, [lane.line for lane in walks]), 0.9) < 0.6, "people walk on them"


def lit(town: TownNetwork) -> TownNetwork:
    """Return a town with lights at its first junction: two phases, by the street that a way begins on."""
    ways = town.junctions["j0"]
    arms = sorted({way.start.road for way in ways})
    state = "".join("G" if way.start.road == arms[0] else "r" for way in ways)
    phases = MapPhase(20.0, state), MapPhase(15.0, state.translate(str.maketrans("Gr", "rG")))
    signal = MapSignal(tuple(way.road for way in ways), phases, offset_s=3.0)
    return replace(town, description=replace(town.description, signals=(signal,)))


def test_lights_come_back_with_controllers() -> None:
    town = lit(town_of(2))
    streets = reread(town)
    found = ways_by_place(town, streets)
    lights = {signal.id: signal for signal in streets.signals if signal.kind == "light"}
    groups = {way.start.road: {lights[s].controller for s in found[way.road].signals} for way in town.junctions["j0"]}
    assert len(lights) == len(groups) >= 3, "one for each arm"
    assert all(len(group) == 1 for group in groups.values())
    first, *others = (groups[arm] for arm in sorted(groups))
    assert first not in others and all(other == others[0] for other in others), "two phases, two controllers"


def test_files_are_the_same_for_the_same_seed() -> None:
    assert opendrive_text(town_of(2)) == opendrive_text(town_network(2, TownOptions()))


@pytest.mark.skipif(not CHECKER, reason="asam-qc-opendrive is not installed: COOPSIM_QC_OPENDRIVE may name its program")
@pytest.mark.parametrize("seed", all_of(map(str, range(10)), "2"))
def test_files_keep_the_rules_of_asam(seed: str, tmp_path: Path) -> None:
    path, results = tmp_path / "town.xodr", tmp_path / "town.xqar"
    path.write_text(opendrive_text(lit(town_of(int(seed)))), encoding="utf-8")
    bundle = f'<CheckerBundle application="xodrBundle"><Param name="resultFile" value="{results}"/></CheckerBundle>'
    config = tmp_path / "config.xml"
    config.write_text(f'<Config><Param name="InputFile" value="{path}"/>{bundle}</Config>', encoding="utf-8")
    subprocess.run([CHECKER, "-c", str(config)], check=True, capture_output=True, cwd=tmp_path)
    said = results.read_text(encoding="utf-8")
    assert re.search(r'status="completed" checkerId="check_asam_xodr_xml_valid_schema"', said)
    assert "<Issue" not in said and said.count('status="completed"') >= 20
