"""Places from files: a layout made by code, written as a file, is the same place; mistakes are said with their line."""

import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from layout_as_yaml import write_layout
from shapely import Polygon
from worlds import DT_S, table

import coopsim
from coopsim.config.annotated import keys_of
from coopsim.envs.simulated.scenario_file import SHIPPED, load_scenario_file
from coopsim.errors import RecordingError, ScenarioFileError
from coopsim.sensors.scene import is_closed
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.custom.conflicts import conflicting_roads
from coopsim.world.places.description import MapBay, MapStart, MapUnit, MapWays
from coopsim.world.places.layout import Layout
from coopsim.world.scenario import SCENARIOS, Place, make_scenario
from coopsim.world.traffic.fleet import PARKED
from coopsim.world.world import World

VILLAGE = SHIPPED / "village.yaml"


def place_of_file(path: Path) -> Place:
    place = load_scenario_file(path).scenario
    assert isinstance(place, Place)
    return place


def village(**numbers: int) -> World:
    file = load_scenario_file(VILLAGE)
    given = {name: value for name, value in file.keywords.items() if name != "options"}
    return World(make_scenario(file.scenario, **{**given, **numbers}), 4)


@pytest.mark.parametrize(("name", "seed"), [("occluded_crossing", 3), ("roundabout", 1), ("merge", 0)])
def test_a_built_in_place_written_as_a_file_is_the_same_place(name: str, seed: int, tmp_path: Path) -> None:
    built_in = make_scenario(name)
    read = make_scenario(
        place_of_file(write_layout(built_in.layout, tmp_path / "copy.yaml")), **asdict(built_in.population)
    )
    assert set(read.layout.movements) == set(built_in.layout.movements)
    assert set(read.layout.priority) == set(built_in.layout.priority)
    as_strict = replace(built_in, layout=replace(built_in.layout, clearance_m=read.layout.clearance_m))
    one, other = World(as_strict, seed), World(read, seed)
    for _ in range(300):
        one.step(DT_S)
        other.step(DT_S)
    np.testing.assert_allclose(table(other.actors()), table(one.actors()), atol=1e-6)
    for agent, body in one.agents().items():
        twin = other.agents()[agent].world_SE3_base
        np.testing.assert_allclose(twin.translation, body.world_SE3_base.translation, atol=1e-6)
        np.testing.assert_allclose(twin.rotation, body.world_SE3_base.rotation, atol=1e-6)


@pytest.mark.parametrize("name", ["crossing", "t_junction", "roundabout", "merge", "parking_street"])
def test_conflicts_are_found_from_how_roads_lie(name: str) -> None:
    layout = SCENARIOS.get(name).make_layout()
    assert set(conflicting_roads(layout.network)) == set(layout.movements)


@pytest.fixture(scope="module")
def drive() -> tuple[Layout, list[World], list[np.ndarray]]:
    worlds = [village(), village(buses=2)]
    speeds = []
    for _ in range(800):
        for world in worlds:
            world.step(DT_S)
        speeds.append(worlds[0]._traffic.fleet.rows["speed"].copy())
    return place_of_file(VILLAGE).make_layout(), worlds, speeds


def test_the_village_drives(drive: tuple[Layout, list[World], list[np.ndarray]]) -> None:
    layout, worlds, speeds = drive
    assert all(world.crashed() == () for world in worlds)
    moving = worlds[0]._traffic.fleet.rows["driver"] != PARKED
    assert np.mean(speeds, axis=0)[moving].mean() > 2.0  # measured: 3.3
    assert (np.max(speeds[200:], axis=0)[moving] > 0.5).all()  # nobody stands for ever
    lanes = [Polygon(outline).buffer(1.5) for outline in layout.road_map.lanes]
    for x, y in worlds[0]._traffic.fleet.position[moving]:
        assert any(lane.contains(Polygon([(x, y), (x + 0.01, y), (x, y + 0.01)])) for lane in lanes)


def test_who_starts_with_a_route_takes_it() -> None:
    world = village()
    layout = place_of_file(VILLAGE).make_layout()
    rows, routes = world._traffic.fleet.rows, world._traffic.fleet.routes
    names = world._traffic._network.roads
    start = layout.slots[layout.connected_order[0]]
    assert [names[k] for k, _ in routes[world._traffic.connected[0]][: len(start.route)]] == list(start.route)
    assert start.route[-2:] == (("west_line", "north_out"), ("north_out", "north_end"))
    visited = set()
    for _ in range(250):
        world.step(DT_S)
        visited.add(world._traffic._network.lane_index[rows["lane"][world._traffic.connected[0]]][:2])
    assert ("north_out", "north_end") in visited


def test_both_engines_drive_the_village_alike() -> None:
    file = load_scenario_file(VILLAGE)
    scenario = make_scenario(file.scenario, vehicles=12, truck_share=0.1, connected_cars=3, rsus=1, pedestrians=0)
    fast, slow = World(scenario, 1), World(scenario, 1, traffic="highway-env")
    for _ in range(150):
        fast.step(DT_S)
        slow.step(DT_S)
    np.testing.assert_allclose(table(fast.actors()), table(slow.actors()), atol=1e-6)


def test_blocks_are_closed_and_as_high_as_said() -> None:
    parts = place_of_file(VILLAGE).make_layout().static
    church = [part for part in parts if part.name == "building"][-1]
    assert is_closed(church.vertices, church.faces)
    assert church.vertices[:, 2].max() == 14.0
    a, b, c = (church.vertices[church.faces[:, k]] for k in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    footprint = Polygon(church.vertices[: len(church.vertices) // 2, :2])
    assert volume == pytest.approx(14.0 * footprint.area)  # positive: faces look outwards


def test_a_place_can_be_recorded_and_played_with_its_file_only(tmp_path: Path) -> None:
    run, other = tmp_path / "run.coopsim", tmp_path / "village.yaml"
    coopsim.record(place_of_file(VILLAGE), run, seed=2, max_cycles=5)
    env = coopsim.parallel_env(VILLAGE, playback=run, **asdict(make_scenario(place_of_file(VILLAGE)).population))
    env.reset(seed=0)
    assert "cav_0" in env.agents
    other.write_text(VILLAGE.read_text().replace("height_m: 14", "height_m: 15"))
    with pytest.raises(RecordingError, match="was recorded in 'village-"):
        coopsim.parallel_env(other, playback=run)


ROADS = """\
place:
  nodes:
    a: [0, -2]
    b: [60, -2]
    c: [60, 2]
    d: [0, 2]
  roads:
    - {from: a, to: b}
    - {from: b, to: c, turn: around}
    - {from: c, to: d}
    - {from: d, to: a, turn: around}
"""


def test_little_is_needed(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(ROADS)
    place = place_of_file(path)
    layout = place.make_layout()
    assert len(layout.slots) == 8 and place.population.vehicles == 5 and place.population.pedestrians == 0
    assert layout.movements == ()
    world = World(make_scenario(place), 0)
    for _ in range(600):
        world.step(DT_S)
    assert world.crashed() == () and world._traffic.fleet.rows["speed"].mean() > 3.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("a: [0, -2]", "a: [0]"), r"own.yaml:3: a must be 2 numbers, got \[0\]"),
        (("a: [0, -2]", "a: [0, x]"), r"own.yaml:3: a must be a finite number, got 'x'"),
        (("to: b}", "to: e}"), r"own.yaml:8: unknown node 'e'. Accepted: a, b, c, d"),
        (
            ("{from: a, to: b}", "{from: a, tu: b}"),
            r"own.yaml:8: unknown key in roads 'tu'. Did you mean 'turn'",
        ),
        (("{from: a, to: b}", "{from: a}"), r"own.yaml:8: to is missing in roads"),
        (("{from: a, to: b}", "{from: a, to: a}"), r"own.yaml:8: a road must lead from one node to another"),
        (("{from: a, to: b}", "{from: a, to: b, speed_m_s: fast}"), r"own.yaml:8: speed_m_s must be in \[1, 40\]"),
        (("{from: a, to: b}", "{from: a, to: b, turn: lift}"), r"own.yaml:8: unknown turn 'lift'. Did you mean 'left'"),
        (("{from: a, to: b}", "{from: a, to: b, turn: left}"), r"own.yaml:8: a bend has both centre and turn"),
        (
            ("{from: a, to: b}", "{from: a, to: b, turn: left, centre: [10, 20]}"),
            r"own.yaml:8: centre must be equally far from both ends, got 24.17 m from 'a' and 54.63 m from 'b'",
        ),
        (
            ("{from: a, to: b}", "{from: a, to: b, turn: left, centre: [30, -22]}"),
            r"own.yaml:8: a bend must be at most half a turn, got 247 degrees to the left",
        ),
        (("{from: a, to: b}", "{from: a, to: b, via: [[58, -2]]}"), r"own.yaml:8: every piece must be at least 5 m"),
        (("{from: a, to: b}", "{from: a, to: b, via: [[30, 20]]}"), r"own.yaml:8: the way turns at once by 73 degrees"),
        (("{from: a, to: b}", "{from: a, to: b, priority: 1}"), r"own.yaml:8: priority must be True or False, got 1"),
        (("    - {from: d, to: a, turn: around}\n", ""), r"own.yaml:10: no road leads on from 'd'"),
        (("c: [60, 2]", "c: [60, 40]"), r"own.yaml:9: a loop must lead from one lane to the next"),
        (("    - {from: c, to: d}", "    - {from: a, to: b}"), r"own.yaml:10: a road from 'a' to 'b' is there already"),
        (("place:", "scenario: merge\nplace:"), r"own.yaml:2: place takes the place of scenario"),
    ],
)
def test_what_is_wrong_with_roads_is_said_with_the_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = ROADS.replace(*change, 1)
    assert text != ROADS
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioFileError, match=message):
        load_scenario_file(path)


def test_a_priority_over_nobody_is_told_and_changes_nothing(tmp_path: Path) -> None:
    path, plain = tmp_path / "own.yaml", tmp_path / "plain.yaml"
    path.write_text(ROADS.replace("{from: a, to: b}", "{from: a, to: b, priority: true}", 1))
    plain.write_text(ROADS)
    with pytest.warns(UserWarning, match=r"own.yaml:8: priority is of no use: no other road crosses or joins"):
        layout = place_of_file(path).make_layout()
    assert layout.priority == place_of_file(plain).make_layout().priority


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            "  starts: [{road: [a, c], at_m: 3}]\n",
            r"own.yaml:12: road must be a road, got \[a, c\]",
        ),
        ("  starts: [{road: [a, b], at_m: 61}]\n", r"own.yaml:12: at_m must be in \[0, 60\], got 61"),
        (
            "  starts:\n    - {road: [a, b], at_m: 3}\n    - {road: [a, b], at_m: 9}\n",
            r"own.yaml:14: starts in one lane must be at least 14 m apart, got 6.0 m from that in line 13",
        ),
        (
            "  parked:\n    - {at: [9, -8], heading_deg: 0}\n    - {at: [15, -8], heading_deg: 0}\n",
            r"own.yaml:14: the vehicle parked here needs 6.3 x 2.4 m, and would overlap with the one parked in line 13",
        ),
        (
            "  parked: [{at: [20, -8], heading_deg: 90, label: bus}]\n",
            r"own.yaml:12: the side of the parked vehicle must be at least 1.7 m from .* got 0.15 m from .* in line 8",
        ),
        (
            "  buildings: [{outline: [[20, -9], [20.4, -9], [20.4, 9], [20, 9]], height_m: 5}]\n",
            r"own.yaml:12: outline must be at least 2 m from the middle of every lane",
        ),
        ("  trees: [{at: [20, -1]}]\n", r"own.yaml:12: at must be at least 2 m from .* got 1.00 m from .* line 8"),
        ("  rsus: [{at: [20, 2], look_at: [0, 0]}]\n", r"own.yaml:12: at must be at least 2 m from .* in line 10"),
        ("  starts: [{road: [a, b], at_m: 3, route: [d]}]\n", r"own.yaml:12: route: there is no road from 'b' to 'd'"),
        ("  parked: [{at: [20, -3], heading_deg: 0}]\n", r"own.yaml:12: at must be at least 3 m from .* in line 8"),
        ("  parked: [{at: [20, -8], heading_deg: 0, label: tram}]\n", r"own.yaml:12: unknown label 'tram'"),
        (
            "  buildings: [{outline: [[0, 9], [9, 9]], height_m: 5}]\n",
            r"own.yaml:12: outline must be at least 3",
        ),
        (
            "  buildings: [{outline: [[0, 9], [9, 9], [3, 12], [0, 20]], height_m: 5}]\n",
            r"own.yaml:12: outline must be convex",
        ),
        ("  trees: [{at: [3, 9], height_m: tall}]\n", r"own.yaml:12: height_m must be in \[2, 60\], got 'tall'"),
        ("  rsus: [{at: [3, 9], look_at: [3, 9]}]\n", r"own.yaml:12: look_at must be another place than at"),
        ("  speeds_m_s: [0, 5, 7]\n", r"own.yaml:12: speeds_m_s must be at least two, rising in equal steps"),
        ("  walks: {nodes: {p: [0, 8], q: [9, 8]}, ways: []}\n", r"own.yaml:12: ways must be at least one"),
        (
            "  walks: {nodes: {p: [0, 8], q: [9, 8], r: [3, 3]}, ways: [[p, q]]}\n",
            r"own.yaml:12: no way leads on from 'r'",
        ),
        ("  walks: {nodes: {p: [0, 8]}, ways: [[p]]}\n", r"own.yaml:12: ways must lead from node to node"),
        ("  housess: []\n", r"own.yaml:12: unknown key in place 'housess'"),
        ("  trees: 3\n", r"own.yaml:12: trees must be a list, got 3"),
    ],
)
def test_what_is_wrong_beside_the_roads_is_said_with_the_line(tmp_path: Path, more: str, message: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(ROADS + more)
    with pytest.raises(ScenarioFileError, match=message):
        load_scenario_file(path)


@pytest.mark.parametrize(
    ("starts", "agent"),
    [
        ("[]", "drone_0"),
        ("[{road: [a, b], at_m: 9}]", "cav_0"),
        ("[{road: [a, b], at_m: 9}, {road: [c, d], at_m: 9}]", "cav_0"),
    ],
)
def test_a_place_with_few_starts_has_an_agent(tmp_path: Path, starts: str, agent: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(f"{ROADS}  starts: {starts}\n")
    assert list(World(make_scenario(place_of_file(path)), 0).agents()) == [agent]


def test_nobody_starts_in_who_starts_on_a_road_that_crosses(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    crossing = (
        "    - {road: [north_line, east_out], at_m: 18.5}\n    - {road: [east_line, west_out], at_m: 12}\n  cars_first"
    )
    path.write_text(VILLAGE.read_text().replace("  cars_first", crossing))
    with pytest.raises(
        ScenarioFileError, match=r"own.yaml:\d+: a vehicle that starts here would overlap with one that starts in line"
    ):
        load_scenario_file(path)


def test_messages_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text("place: {}\n")
    with pytest.raises(ScenarioFileError, match=re.escape(f"{path}:1: nodes is missing in place")):
        coopsim.parallel_env(path)


def test_a_parked_bus_may_stand_in_a_bay(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(ROADS + "  parked: [{at: [20, -12], heading_deg: 90, label: bus}]\n")
    scenario = make_scenario(place_of_file(path), parked=1)
    rows = World(scenario, 0)._traffic.fleet.rows
    assert (rows["heading"][-1], rows["x"][-1]) == (pytest.approx(np.pi / 2), pytest.approx(20, abs=0.2))
    assert scenario.layout.bays[0].label == ObjectClass.BUS


def test_the_page_has_the_keys_of_starts_bays_units_and_ways() -> None:
    page = (Path(__file__).parents[4] / "docs/reference/scenarios.md").read_text(encoding="utf-8")
    rows = page[page.index("| key | of each item |\n|---|---|\n| `starts`") :]
    for name, kind in (("starts", MapStart), ("parked", MapBay), ("rsus", MapUnit)):
        row = rows[rows.index(f"| `{name}` |") :].split("\n| `")[0].split("\n\n")[0]
        assert set(re.findall(r"`(\w+)`", row)) - {name, "truck"} == set(keys_of(kind)), name
    ways = rows[rows.index("| key of `walks` and `rides` | value |") :].split("\n\n")[0]
    assert re.findall(r"\n\| `(\w+)` \|", ways) == list(keys_of(MapWays))
