"""Routes of CARLA's files: read in both forms, put on lanes, and driven from their start to their end."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tiny_maps import THREE_ROADS, written

from coopsim.data.maps.place.carla_routes import read_routes, start_on
from coopsim.data.maps.place.cut import cut_out
from coopsim.data.maps.place.describe import describe_place
from coopsim.data.maps.reading import read_map
from coopsim.errors import InvalidValueError, MapFileError, UnknownNameError
from coopsim.world.custom.place import place_from
from coopsim.world.drawn_places import choose_scenarios
from coopsim.world.places.layout import Layout
from coopsim.world.situations.route_drive import RouteDrive
from coopsim.world.world import World

CENTRE = (110.0, -5.0)
TURN = [(60.0, 1.75), (108.25, 30.0)]
"""From the first of three roads, 40 m before its end, to 20 m along that on the right; CARLA's y points right."""
TURN_M = 40.0 + np.pi / 2 * 8.25 + 20.0
FEW = {"vehicles": 4, "truck_share": 0.0, "connected_cars": 1, "pedestrians": 0, "rsus": 0, "bicycles": 0}


def routes_of(folder: Path, *routes: list[tuple[float, float]]) -> Path:
    """Write a file of routes as CARLA's leaderboard 1.0 has them."""
    rows = [[f'<waypoint pitch="0.0" x="{x}" y="{y}" yaw="9" z="0.0" />' for x, y in each] for each in routes]
    text = "".join(f'<route id="{k}" town="Town09">\n{"".join(row)}</route>\n' for k, row in enumerate(rows))
    return written(folder, f"<?xml version='1.0' encoding='utf-8'?>\n<routes>\n{text}</routes>", "routes.xml")


@cache
def three_roads(folder: Path) -> Layout:
    cut = cut_out(read_map(written(folder, THREE_ROADS)), CENTRE, 100.0)
    return place_from(describe_place(cut, 0), "three roads").make_layout()


def put(folder: Path, *points: tuple[float, float]) -> tuple[Layout, float]:
    """Put the start of a route of these waypoints on the three roads; return the layout and the route's length."""
    (route,) = read_routes(routes_of(folder, list(points)))
    return start_on(three_roads(folder), route, CENTRE)


def test_waypoints_are_read_in_both_forms(tmp_path: Path) -> None:
    (first, second) = read_routes(routes_of(tmp_path, TURN, [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]))
    np.testing.assert_array_equal(first.points, [[60.0, -1.75], [108.25, -30.0]])
    assert len(second.points) == 3
    text = '<routes><route id="7" town="T"><weathers/><waypoints><position x="60.0" y="1.75" z="9"/>'
    text += '<position x="108.25" y="30.0" z="9"/></waypoints><scenarios/></route></routes>'
    (again,) = read_routes(written(tmp_path, text, "b2d.xml"))
    np.testing.assert_array_equal(again.points, first.points)
    assert first.around == (84.125, -15.875)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<routes/>", "b.xml:1: <routes> has no routes; accepted: <routes> with <route>"),
        ("<net><route id='1'/></net>", "<net> has no routes"),
        (
            "<routes>\n<route id='1'><waypoint x='1' y='2'/></route></routes>",
            "b.xml:2: .* two waypoints, got 1",
        ),
        ("<routes><route><waypoint x='1' y='a'/><waypoint x='1' y='2'/></route></routes>", "y must be a number"),
        ("<routes><route><waypoint x='1'/><waypoint x='1' y='2'/></route></routes>", "must have the attribute y"),
        ("<!DOCTYPE a [<!ENTITY e 'x'>]><routes/>", "entity 'e' is refused"),
    ],
)
def test_wrong_files_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match=message):
        read_routes(written(tmp_path, text, "b.xml"))


def test_a_route_starts_at_its_first_waypoint_and_is_as_long_as_its_lanes(tmp_path: Path) -> None:
    layout, length_m = put(tmp_path, *TURN)
    slot = layout.slots[0]
    place = layout.network.get_lane(slot.lane).position(slot.along_m, 0.0)
    np.testing.assert_allclose(place + CENTRE, [60.0, -1.75], atol=0.01)
    assert length_m == pytest.approx(TURN_M, abs=0.3)
    assert slot.route[0] == slot.lane[:2] and slot.route[-1][0] == "3.0.-1<"
    assert layout.connected_order[0] == 0
    others = [layout.network.get_lane(each.lane).position(each.along_m, 0.0) for each in layout.slots[1:]]
    assert len(others) and np.hypot(*(np.array(others) - place).T).min() > 12.0


def test_the_way_leads_by_waypoints_in_between(tmp_path: Path) -> None:
    _, length_m = put(tmp_path, (60.0, 1.75), (80.0, 2.5), (110.0, 1.75), (160.0, 1.75))
    assert length_m == pytest.approx(100.0, abs=0.1)


def test_a_waypoint_counts_for_the_nearest_lane_only_if_that_is_near(tmp_path: Path) -> None:
    back, _ = put(tmp_path, (160.0, -0.2), (60.0, -1.75))
    assert back.slots[0].lane[0].startswith("2.0.1")
    _, length_m = put(tmp_path, (60.0, 1.75), (90.0, 11.0))
    assert length_m == pytest.approx(30.0, abs=0.1)
    with pytest.raises(MapFileError, match=r"routes.xml:3: <route id='0'> must .* within 10 m .* x=90, y=12 of T"):
        put(tmp_path, (60.0, 1.75), (90.0, 12.0))


def test_a_route_without_a_way_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="no way leads to waypoint 2"):
        put(tmp_path, (108.25, 30.0), (60.0, 1.75))


def test_cars_start_on_the_route_and_have_its_end_as_their_goal(tmp_path: Path) -> None:
    path, file = str(written(tmp_path, THREE_ROADS)), str(routes_of(tmp_path, [(60.0, 1.75), (160.0, 1.75)], TURN))
    scenarios = choose_scenarios(path, routes=file, **FEW)  # type: ignore[arg-type]
    scenario = next(each for each in map(scenarios.of, range(20)) if each.place_seed % 2)  # type: ignore[operator]
    world = World(scenario, 3, control="steering", driven=["cav_0"], route_m=(200.0, 2000.0))
    car, row = world.car_ahead("cav_0"), world.fleet.rows[world.row_of("cav_0")]
    around = (84.125, -15.875)
    assert np.hypot(row["x"] + around[0] - 60.0, row["y"] + around[1] + 1.75) < 1.01
    assert car.route.length_m == pytest.approx(TURN_M, abs=0.3)
    assert choose_scenarios(path, **FEW).of(0).route_m is None  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="vehicles must be at least 3 with routes"):
        choose_scenarios(path, routes=file, **FEW | {"vehicles": 2})  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="around must be left out with routes"):
        choose_scenarios(path, routes=file, around=(0, 0), **FEW)  # type: ignore[arg-type]
    far = str(routes_of(tmp_path, [(0.0, 0.0), (9e3, 0.0)]))
    with pytest.raises(InvalidValueError, match="route '0' needs 4560 m"):
        choose_scenarios(path, routes=far, **FEW)  # type: ignore[arg-type]


def test_the_situation_route_takes_routes_on_maps_only(tmp_path: Path) -> None:
    path, file = str(written(tmp_path, THREE_ROADS)), str(routes_of(tmp_path, TURN))
    drive = RouteDrive(place=path, routes=file, vehicles=6, pedestrians=0, parked=0, penetration=0.0)
    found = drive.of(4)
    assert found.route_m is not None and found.route_m[0] == pytest.approx(TURN_M, abs=0.3)
    with pytest.raises(UnknownNameError, match="routes"):
        RouteDrive(place="town", routes=file).of(0)
