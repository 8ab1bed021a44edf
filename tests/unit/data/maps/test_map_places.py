"""Places of maps: their lanes, right of way, lights and loops, and scenarios in them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lit_crossing import crossing
from tiny_maps import SUMO, THREE_ROADS, written

from coopsim.data.maps.place.clear import clear_of_roads
from coopsim.data.maps.place.cut import cut_out, distances_m
from coopsim.data.maps.place.describe import describe_place
from coopsim.data.maps.place.lines import rounded, simplified, turns_rad
from coopsim.data.maps.place.rights import add_yields
from coopsim.data.maps.place.scenarios import _Needs
from coopsim.data.maps.place.strips import Strip, strips_of
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import SignalProgram, StreetJunction, StreetLane, StreetMap, StreetWay, Turn
from coopsim.errors import CrowdedWarning, InvalidValueError, UnknownNameError
from coopsim.world.custom.conflicts import conflicting_roads
from coopsim.world.custom.place import place_from
from coopsim.world.drawn_places import choose_scenarios, find_drawer, is_place_file
from coopsim.world.places.description import MapArea, MapBay, MapLane, MapWays
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import RoadNetwork


def lane(name: str, *points: tuple[float, float], **more: object) -> StreetLane:
    line = np.array([[*point, 0.0] for point in points])
    return StreetLane(name, name, "drive", line, np.full(len(line), 3.5), **more)  # type: ignore[arg-type]


def map_of(*lanes: StreetLane, **links: tuple[str, ...]) -> StreetMap:
    return StreetMap(
        source="x", format="x", lanes={each.id: each for each in lanes}, links=links, ways={}, junctions={}
    )


@pytest.fixture
def three_roads(tmp_path: Path) -> StreetMap:
    return cut_out(read_map(written(tmp_path, THREE_ROADS, "map.xodr")), (110.0, -5.0), 90.0)


@pytest.fixture
def lit(tmp_path: Path) -> StreetMap:
    return cut_out(read_map(written(tmp_path, SUMO, "map.net.xml")), (105.0, -2.0), 80.0)


def test_lanes_that_follow_each_other_are_one() -> None:
    lanes = lane("a", (0, 0), (50, 0)), lane("b", (50, 0), (60, 0)), lane("c", (60, 0), (100, 5))
    strips = strips_of(map_of(*lanes, a=("b",), b=("c",))).all
    assert set(strips) == {"a"} and strips["a"].line[-1].tolist() == [100.0, 5.0, 0.0]


def test_a_lane_that_opens_begins_in_its_neighbour() -> None:
    lanes = (
        lane("a", (0, 0), (50, 0)),
        lane("b", (50, 0), (150, 0), right="c"),
        lane("c", (50, -3.5), (150, -3.5), left="b"),
    )
    strips = strips_of(map_of(*lanes, a=("b",))).all
    assert strips["c"].start == strips["b"].start == strips["a"].end
    assert strips["c"].line[0].tolist() == [50.0, 0.0, 0.0]
    assert strips["c"].line[-1].tolist() == [150.0, -3.5, 0.0]


def test_a_lane_that_closes_joins_its_neighbour_and_yields() -> None:
    lanes = (
        lane("a", (0, 0), (100, 0), right="c"),
        lane("b", (100, 0), (200, 0)),
        lane("c", (0, -3.5), (100, -3.5), left="a"),
    )
    strips = strips_of(map_of(*lanes, a=("b",))).all
    assert strips["c~"].end == strips["a~"].end == strips["b"].start
    assert strips["c~"].yields == ("a~",) and strips["a~"].yields == ()
    assert strips["c~"].length_m == pytest.approx(30.0, abs=0.5), "only the last metres are a join"


def test_a_lane_that_the_circle_cuts_does_not_join_its_neighbour() -> None:
    lanes = (
        lane("a", (0, 0), (100, 0), right="c"),
        lane("b", (100, 0), (200, 0)),
        lane("c", (0, -3.5), (70, -3.5), left="a"),
    )
    strips = strips_of(map_of(*lanes, a=("b",))).all
    assert strips["c"].line[-1].tolist() == [70.0, -3.5, 0.0]


def test_the_file_says_who_yields(three_roads: StreetMap) -> None:
    roads = {(road.start, road.end): road for road in describe_place(three_roads, 0).roads}
    ahead, right = roads["1.0.-1>", "2.0.-1<"], roads["1.0.-1>", "3.0.-1<"]
    assert right.yields == (("1.0.-1>", "2.0.-1<"),) and ahead.yields == ()
    assert all(road.curved or road.turn == "around" for road in roads.values())


def way(start: str, end: str, turn: Turn, *points: tuple[float, float]) -> StreetWay:
    line = np.array([[*point, 0.0] for point in points])
    return StreetWay(f"{start}>{end}", start, end, "j", line, np.full(len(line), 3.5), None, turn)


@pytest.mark.parametrize("left_hand", [False, True])
def test_without_a_word_from_the_file_turns_across_yield_to_oncoming_traffic(left_hand: bool) -> None:
    side = -1.0 if left_hand else 1.0
    turn: Turn = "right" if left_hand else "left"
    lanes = (
        lane("in", (-60, -2 * side), (0, -2 * side)), lane("out", (20, -2 * side), (80, -2 * side)),
        lane("coming", (80, 2 * side), (20, 2 * side)), lane("gone", (0, 2 * side), (-60, 2 * side)),
        lane("up", (12, 12 * side), (12, 60 * side)),
    )  # fmt: skip
    corner = ((0.0, -2 * side), (6.0, -1.5 * side), (10.0, 2 * side), (11.5, 6 * side), (12.0, 12 * side))
    ways = (
        way("in", "out", "straight", (0, -2 * side), (20, -2 * side)), way("in", "up", turn, *corner),
        way("coming", "gone", "straight", (20, 2 * side), (0, 2 * side)),
    )  # fmt: skip
    streets = replace(
        map_of(*lanes),
        ways={each.id: each for each in ways},
        junctions={"j": StreetJunction("j", "")},
        left_hand=left_hand,
    )
    strips = strips_of(streets)
    inside = [each for each in strips.all.values() if each.way]
    add_yields(streets, inside)
    assert {each.name: each.yields for each in inside} == {"in>up": ("coming>gone",), "coming>gone": ()}


def test_a_program_of_the_file_runs_and_an_endless_one_is_replaced(lit: StreetMap) -> None:
    (signal,) = describe_place(lit, 0).signals
    assert [(phase.seconds, phase.state[:2]) for phase in signal.phases] == [(20.0, "Gg"), (5.0, "rr")]
    endless = replace(lit, programs={"J": SignalProgram("J", 0.0, ((10_000.0, "Ggr"),))})
    made = describe_place(endless, 0).signals
    assert all(phase.seconds <= 120.0 for signal in made for phase in signal.phases)


def test_points_that_are_not_needed_are_left_out_and_corners_are_round() -> None:
    line = np.array([[0.0, 0, 0], [10, 0.01, 0], [20, 0, 0], [20, 20, 0]])
    kept, width_m = simplified(line, np.full(4, 3.0))
    assert kept.tolist() == line[[0, 2, 3]].tolist() and len(width_m) == 3
    smooth, _ = rounded(kept, width_m)
    assert np.degrees(turns_rad(smooth).max()) < 30 and smooth[[0, -1]].tolist() == line[[0, -1]].tolist()


def test_slight_corners_of_long_pieces_are_round_too() -> None:
    line = np.array([[0.0, 0.0, 0.0], [40.0, 0.0, 0.0], [80.0, 9.0, 0.0]])
    smooth, _ = rounded(line, np.full(3, 3.2))
    assert np.degrees(turns_rad(smooth).max()) < np.degrees(turns_rad(line).max()) / 2 + 0.1
    assert distances_m([smooth], line[1, :2])[0] < 0.5
    short = np.vstack([line, [[83.0, 10.5, 0.0]]])
    assert rounded(short, np.full(4, 3.2))[0][-2:].tolist() == short[-2:].tolist()


def test_a_place_that_connected_cars_would_have_to_leave_lacks_something() -> None:
    place = place_from(crossing(), "cut")
    assert _Needs(3, 0).lacking(place) is None
    assert _Needs(3, 0, stays=1).lacking(place) == "places that connected cars would have to leave"


@pytest.mark.parametrize(("length_m", "beyond_m"), [(200.0, 0.0), (45.0, 32.0)])
def test_loops_lie_within_the_place_where_lanes_are_long_enough(length_m: float, beyond_m: float) -> None:
    half_m = length_m / 2
    described = describe_place(map_of(lane("a", (-half_m, 0), (half_m, 0)), lane("b", (half_m, 4), (-half_m, 4))), 0)
    assert [road.turn for road in described.roads].count("around") == 2
    layout = place_from(described, "loops").make_layout()
    reach_m = max(
        float(np.abs(each.positions(np.linspace(0, each.length, 9), 0.0)).max())
        for each in layout.network.lanes.values()
    )
    assert half_m + beyond_m - 5 < reach_m < half_m + beyond_m + 1


def test_vehicles_in_two_loops_do_not_meet() -> None:
    pairs = [
        (lane(f"a{k}", (-80, y), (80, y)), lane(f"b{k}", (80, y + 4), (-80, y + 4))) for k, y in enumerate((0.0, 21.0))
    ]
    described = describe_place(map_of(*pairs[0], *pairs[1]), 0)
    lanes = place_from(described, "loops").make_layout().network.lanes
    loops = [(road.start, road.end) for road in described.roads if road.turn == "around"]
    lines = [
        np.concatenate(
            [
                each.positions(np.linspace(0, each.length, 30), 0.0)
                for name, each in lanes.items()
                if f"{start}>{end}." in name[0]
            ]
        )
        for start, end in loops
    ]
    assert len(lines) > 2
    for k, line in enumerate(lines):
        for other in lines[:k]:
            assert np.hypot(*(line[:, None] - other).transpose(2, 0, 1)).min() > 5.0


def test_a_map_is_a_scenario_by_its_path(tmp_path: Path) -> None:
    path = str(written(tmp_path, THREE_ROADS, "map.xodr"))
    assert is_place_file(path) and is_place_file(Path(path)) and not is_place_file("town")
    assert find_drawer("town") is not None and find_drawer("crossing") is None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scenarios = choose_scenarios(
            path,
            around=(110.0, -5.0),
            radius_m=90.0,
            connected_cars=1,
            vehicles=3,
            rsus=0,
            pedestrians=0,
            detail="plain",
        )
        one, two, again = scenarios.of(3), scenarios.of(4), scenarios.of(3)
    assert one.description == again.description and one.place_seed == 3
    assert one.description is not None and two.description is not None
    assert one.description.roads == two.description.roads and one.description.cut


def test_a_map_without_a_place_for_a_unit_has_none_unless_asked_for(tmp_path: Path) -> None:
    path = str(written(tmp_path, THREE_ROADS, "map.xodr"))
    options = {"around": (110.0, -5.0), "radius_m": 90.0, "connected_cars": 1, "vehicles": 3, "detail": "plain"}
    scenarios = choose_scenarios(path, **options)  # type: ignore[arg-type]
    assert scenarios.of(3).population.rsus == 0
    with pytest.raises(InvalidValueError, match="less than 1 places for roadside units"):
        choose_scenarios(path, rsus=1, **options)  # type: ignore[arg-type]


def test_vehicles_are_as_many_as_drive_in_a_place(tmp_path: Path) -> None:
    path = str(written(tmp_path, THREE_ROADS, "map.xodr"))
    with pytest.warns(CrowdedWarning, match="there is room for 8 of 100 "):
        scenario = choose_scenarios(
            path, around=(110.0, -5.0), radius_m=90.0, connected_cars=2, vehicles=100, detail="plain"
        ).of(3)
    assert scenario.population.vehicles == 8 == int(0.6 * len(scenario.layout.slots))


def test_what_would_stand_on_lanes_or_loops_is_left_out() -> None:
    strips = [Strip("a", "s", "e", np.array([[0.0, 0, 0], [100, 0, 0]]), np.full(2, 3.5), None)]
    nodes = {"e": (100.0, 0.0), "s": (100.0, 5.0)}
    across, along = MapBay((50.0, 4.0), 90.0), MapBay((50.0, -3.4), 0.0)
    in_loop, beyond = MapBay((135.0, 2.5), 0.0), MapBay((140.0, 2.5), 0.0)
    points = {"a": (60.0, -6.0), "b": (80.0, -6.0), "c": (115.0, -40.0), "d": (115.0, 40.0), "e": (80.0, 40.0)}
    fields = {"parked": (across, along, in_loop, beyond), "walks": MapWays(points, (("a", "b", "c", "d", "e"),))}
    found = clear_of_roads(fields, strips, [MapLane("e", "s", turn="around")], nodes)
    assert found["parked"] == (along, beyond)
    assert found["walks"].ways == (("a", "b", "c"), ("d", "e")), "nobody walks through a loop"


def test_a_pavement_that_reaches_over_a_lane_between_its_corners_is_left_out() -> None:
    strips = [Strip("a", "s", "e", np.array([[0.0, 0, 0], [100, 0, 0]]), np.full(2, 3.5), None)]
    over, beside = (MapArea(((40.0, 5.0), (60.0, 5.0), (50.0, far_m)), "pavement") for far_m in (-5.0, 2.0))
    assert clear_of_roads({"paved": (over, beside)}, strips, [], {})["paved"] == (beside,)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"around": "here"}, "around must be two numbers, x and y in m"),
        ({"around": (5000, 0)}, "around must be at most 60 m from a lane"),
        ({"radius_m": 20}, "radius_m must be"),
        ({"around": (110, -5), "rsus": 99}, "places with less than 99 places for roadside units"),
        ({"around": (110, -5), "vehicles": 3, "penetration": None, "lanes": 2}, "lanes"),
    ],
)
def test_wrong_options_are_named(tmp_path: Path, options: dict[str, object], said: str) -> None:
    path = str(written(tmp_path, THREE_ROADS, "map.xodr"))
    with pytest.raises((InvalidValueError, UnknownNameError), match=said):
        choose_scenarios(path, detail="plain", **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("radius_m", "meet"), [(8.0, True), (40.0, False)])
def test_oncoming_vehicles_take_turns_in_a_narrow_bend(radius_m: float, meet: bool) -> None:
    angle = np.linspace(0.0, np.pi / 2, 8)
    network = RoadNetwork()
    for name, radius, flip in (("in", radius_m, 1), ("out", radius_m + 4.0, -1)):
        bend = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        network.add_lane(f"{name} a", f"{name} b", PolylineLane(bend[::flip]))
    assert len(conflicting_roads(network)) == (2 if meet else 0)


def test_a_turn_that_no_vehicle_can_make_is_left_out_where_one_to_the_same_road_is_wider() -> None:
    lanes = (
        lane("in", (-60, 0), (0, 0)),
        replace(lane("near", (0, 5), (-60, 5), right="next"), road="back"),
        replace(lane("next", (0, 5.4), (-60, 8.5), left="near", right="far"), road="back"),
        replace(lane("far", (0, 12), (-60, 12), left="next"), road="back"),
    )
    far = way("in", "far", "left", (0, 0), (6, 6), (0, 12))
    near = way("in", "near", "left", (0, 0), (2.5, 2.5), (0, 5))
    hooked = way("in", "near", "left", (0, 0), (10, 0.5), (11.5, 2), (10.5, 3.5), (0, 5))  # wide on the whole
    after = way("in", "next", "left", (0, 0), (2.7, 2.7), (0, 5.4))
    for kept in ([near, after, far], [hooked, after, far], [near]):
        streets = replace(
            map_of(*lanes), ways={each.id: each for each in kept}, junctions={"j": StreetJunction("j", "")}
        )
        strips = strips_of(streets).all
        assert [name for name in strips if ">" in name] == [kept[-1].id], "that alone leads there: it is kept"
        assert strips["near"].start == strips[kept[-1].id].end, "its lane begins in the other"
