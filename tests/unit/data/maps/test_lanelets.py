"""A small map of Lanelet2: directions, neighbours, junctions, lights, limits, who yields."""

from __future__ import annotations

import gzip
import warnings
from pathlib import Path

import numpy as np
import pytest
from tiny_maps import written
from tiny_osm import LANELETS, border, lanelet, node, osm, way

from coopsim.data.maps.lanelet2.borders import middle_of, turned
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.errors import MapWarning


@pytest.fixture(scope="module")
def streets(tmp_path_factory: pytest.TempPathFactory) -> StreetMap:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_map(written(tmp_path_factory.mktemp("maps"), LANELETS, "a.osm"))


def directions(streets: StreetMap) -> dict[str, tuple[int, int]]:
    steps = {name: lane.line[-1, :2] - lane.line[0, :2] for name, lane in streets.lanes.items()}
    return {name: (round(x), round(y)) for name, (x, y) in steps.items()}


def test_the_left_border_tells_the_direction(streets: StreetMap) -> None:
    found = directions(streets)
    assert {name: found[name] for name in "ABCDE"} == {
        "A": (100, 0), "B": (100, 0), "C": (60, 0), "D": (0, -50), "E": (-100, 0),
    }  # fmt: skip
    assert np.allclose(streets.lanes["B"].width_m, 3.0, atol=0.01)
    assert not streets.left_hand


def test_kinds_limits_and_neighbours(streets: StreetMap) -> None:
    lanes = streets.lanes
    assert (lanes["E"].kind, lanes["W"].kind, "Z" in lanes) == ("drive", "walk", False)
    assert [lanes[name].speed_m_s for name in "ABCD"] == [50 / 3.6, 10.0, pytest.approx(13.41, abs=0.01), None]
    assert (lanes["A"].right, lanes["B"].left, lanes["B"].right, lanes["E"].left) == ("B", "A", None, None)
    assert lanes["B"].road == lanes["A"].road == "A"


def test_lanelets_that_part_join_or_cross_are_ways_of_a_junction(streets: StreetMap) -> None:
    turns = {name: way.turn for name, way in streets.ways.items()}
    assert turns == {"B>C": "straight", "B>D": "right", "F>D": "straight"}
    assert len(streets.junctions) == 1 and not streets.links
    (junction,) = streets.junctions.values()
    assert junction.yields == {("B>C", "F>D"), ("B>D", "F>D")}
    assert {way.junction for way in streets.ways.values()} == {junction.id}


def test_lights_crossings_and_what_stands_there(streets: StreetMap) -> None:
    (light,) = streets.signals
    assert (light.kind, light.lanes) == ("light", ("B",)) and abs(light.heading_rad) < 1e-3
    assert [name for name, way in streets.ways.items() if way.signals == ("L",)] == ["B>C", "B>D"]
    (crossing,) = streets.crossings
    assert crossing.width_m == pytest.approx(4, abs=0.01)
    assert {(each.kind, each.height_m) for each in streets.solids} == {("wall", 1.5), ("building", 8.0)}


def test_opposite_lanelets_on_the_right_mean_left_hand_traffic(tmp_path: Path) -> None:
    text = osm(border("a", [(0, 3), (50, 3)]), border("b", [(0, 0), (50, 0)]), border("c", [(0, -3), (50, -3)]),
               lanelet("A", "a", "b"), lanelet("B", "c", "b"))  # fmt: skip
    streets = read_map(written(tmp_path, text, "a.osm"))
    assert streets.left_hand and directions(streets) == {"A": (50, 0), "B": (-50, 0)}


def test_local_coordinates_and_heights_count_before_degrees(tmp_path: Path) -> None:
    rows = [("a", 0, 3), ("b", 50, 3), ("c", 0, 0), ("d", 50, 0)]
    nodes = "".join(
        f'<node id="{name}" lat="" lon="">'
        f'<tag k="local_x" v="{x}"/><tag k="local_y" v="{y}"/><tag k="ele" v="-4.5"/></node>'
        for name, x, y in rows
    )
    ways = way("1", "a b", {}) + way("2", "c d", {})
    streets = read_map(written(tmp_path, osm(nodes, ways, lanelet("A", "1", "2")), "a.osm"))
    assert streets.lanes["A"].line[[0, -1]].tolist() == [[0, 1.5, -4.5], [50, 1.5, -4.5]] and streets.projection == ""


def test_a_map_whose_y_points_south_is_turned(tmp_path: Path) -> None:
    mirrored = lanelet("A", "a", "b").replace("<tag", '<member type="way" ref="m" role="centerline"/><tag', 1)
    text = osm(border("a", [(0, -3), (50, -3)]), border("b", [(0, 0), (50, 0)]), border("m", [(0, -1.5), (50, -1.5)]),
               mirrored)  # fmt: skip
    with pytest.warns(MapWarning, match="y points south"):
        streets = read_map(written(tmp_path, text, "a.osm.gz"))
    assert directions(streets) == {"A": (50, 0)}


def test_bridges_are_no_crossings(tmp_path: Path) -> None:
    """A lanelet that goes over another, 6 m higher."""

    def street(name: str, xs: list[float], ys: list[float], height: str) -> str:
        """Return three lanelets in a row."""
        parts = ""
        for side, shift in (("l", 1.5), ("r", -1.5)):
            dx, dy = (0.0, shift) if xs[0] != xs[-1] else (-shift, 0.0)
            for k, (x, y) in enumerate(zip(xs, ys, strict=True)):
                parts += node(f"{name}{side}{k}", x + dx, y + dy, ele=height)
            for k in range(3):
                parts += way(f"{name}{side}{k}", f"{name}{side}{k} {name}{side}{k + 1}", {})
        return parts + "".join(lanelet(f"{name}{k}", f"{name}l{k}", f"{name}r{k}") for k in range(3))

    flat, steps = [0.0] * 4, [-90.0, -30.0, 30.0, 90.0]
    for height, ways in (("6", 0), ("0", 2)):
        text = osm(street("a", steps, flat, "0"), street("b", flat, steps, height))
        assert len(read_map(written(tmp_path, text, "a.osm")).ways) == ways


def test_middles_of_arcs_lie_in_the_middle() -> None:
    """Borders with different numbers of points, along a quarter of a circle of 10 m."""

    def arc(radius: float, count: int) -> np.ndarray:
        angle = np.linspace(0, np.pi / 2, count)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)])

    line, width = middle_of(arc(8.5, 60), arc(11.5, 90))
    assert np.abs(np.linalg.norm(line[:, :2], axis=1) - 10).max() < 0.02 and np.abs(width - 3).max() < 0.02
    assert turned(arc(8.5, 60), arc(11.5, 90)) == (False, False) and turned(arc(11.5, 9), arc(8.5, 9)) == (True, True)
    assert turned(arc(8.5, 60), arc(11.5, 90)[::-1]) == (False, True)


def test_gzip_is_read_as_well(streets: StreetMap, tmp_path: Path) -> None:
    path = tmp_path / "b.osm.gz"
    path.write_bytes(gzip.compress(LANELETS.encode()))
    assert list(read_map(path).lanes) == list(streets.lanes)


@pytest.mark.parametrize(
    ("subtype", "other", "changes"),
    [("dashed", "", True), ("solid", "", False), ("dashed", "no", False), ("solid", "yes", True)],
)
def test_borders_say_where_lanes_are_changed(subtype: str, other: str, changes: bool, tmp_path: Path) -> None:
    tags = {"subtype": subtype, **({"lane_change": other} if other else {})}
    text = osm(border("a", [(0, 3), (50, 3)]), border("b", [(0, 0), (50, 0)], tags), border("c", [(0, -3), (50, -3)]),
               lanelet("A", "a", "b"), lanelet("B", "b", "c"))  # fmt: skip
    lanes = read_map(written(tmp_path, text, "a.osm")).lanes
    assert (lanes["A"].right == "B" and lanes["B"].left == "A") is changes
