"""Ways of steered cars to their goals: drawn by the seed, along lanes, with lights as they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lit_crossing import LINE_M, crossing
from worlds import DT_S, make_world

from coopsim.errors import InvalidValueError
from coopsim.types.driving import GREEN, NO_LIGHT, RED
from coopsim.world.custom.place import place_from
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.navigation import checked_route, draw_roads
from coopsim.world.world import World


def lit(control: str, seed: int) -> World:
    numbers = {"vehicles": 8, "buses": 0, "connected_cars": 4, "rsus": 0, "pedestrians": 0}
    return World(make_scenario(place_from(crossing(lights=True, cut=False), "lit"), **numbers), seed, control=control)


def test_a_steered_car_is_shown_lights_and_stops_as_one_on_rails_is() -> None:
    stops, lights = [], set()
    names = ("cav_0", "cav_1", "cav_2", "cav_3")
    for seed, steps in ((0, 0), (2, 170)):
        steered, railed = lit("steering", seed), lit("acceleration", seed)
        for _ in range(steps):  # until it is red
            steered.step(DT_S, dict.fromkeys(names, (-8.0, 0.0)))
            railed.step(DT_S, dict.fromkeys(names, -8.0))
        for name in names:
            routes = [world.car_ahead(name).route for world in (steered, railed)]
            found = [np.flatnonzero(route.speed_limit_m_s == 0)[:1].tolist() for route in routes]
            stops.append(found)
            lights |= set(routes[0].lights.tolist())
            first = [np.flatnonzero(route.lights)[:1].tolist() for route in routes]
            assert np.abs(np.subtract(*first)).max(initial=0) <= 2  # they stood after ways by other sums
            assert len(routes[0].beside) == len(routes[0].lane_width_m) == 101
    assert lights == {NO_LIGHT, GREEN, RED} and any(one for one, _ in stops)
    assert all(len(one) == len(other) and abs(sum(one) - sum(other)) <= 2 for one, other in stops)


@pytest.mark.parametrize(("control", "command"), [("acceleration", 3.0), ("steering", (3.0, 0.0))])
def test_a_car_whose_front_crosses_the_line_at_red_has_run_it_once_and_then(control: str, command: Any) -> None:
    """Lines are 14 m from the middle of the crossing: fronts cross them where the map says, seconds before middles."""
    world, names = lit(control, 2), [f"cav_{k}" for k in range(4)]
    brake = -8.0 if control == "acceleration" else (-8.0, 0.0)
    for _ in range(170):  # until it is red
        world.step(DT_S, dict.fromkeys(names, brake))
    before, ran = {name: inside(world, name) for name in names}, dict.fromkeys(names, 0)
    for _ in range(60):
        world.step(DT_S, dict.fromkeys(names, command))
        for name in names:
            car, now = world.car_ahead(name), inside(world, name)
            lights = car.route.lights[car.route.lights > NO_LIGHT]
            ran[name] += now and not before[name] and lights[0] == RED
            before[name] = now
            assert car.red_lights == ran[name]
    assert set(ran.values()) == {0, 1}


def inside(world: World, name: str) -> bool:
    """Return whether the front of a car is within the crossing of `lit`."""
    row = world.fleet.rows[world.row_of(name)]
    ahead = row["length"] / 2 * np.array([np.cos(row["heading"]), np.sin(row["heading"])])
    return bool(np.abs(ahead + np.array([row["x"], row["y"]])).max() < LINE_M)


def test_ways_are_as_long_as_asked_turn_and_differ() -> None:
    world = make_world("urban_grid", 2, control="steering", vehicles=4, connected_cars=3)
    ways = [world._traffic._steered._ways[k] for k in world._traffic.connected]  # type: ignore[union-attr]
    lengths = [world.car_ahead(f"cav_{k}").route.length_m for k in range(3)]
    assert len(set(lengths)) == 3 and all(200 <= length <= 2000 for length in lengths)
    for way in ways:
        steps = np.diff(way._points, axis=0)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        assert np.ptp(headings) > 1.0 and np.hypot(*steps.T).max() < 1.6
    again = make_world("urban_grid", 2, control="steering", vehicles=4, connected_cars=3)
    same = again._traffic._steered._ways[again._traffic.connected[0]]  # type: ignore[union-attr]
    np.testing.assert_array_equal(ways[0]._points, same._points)


def test_a_way_takes_no_road_twice_while_others_lead_on() -> None:
    world = make_world("urban_grid", 0, vehicles=1)
    network = world._traffic._network.arrays
    roads, length_m = draw_roads(network, [0], 0.0, 400.0, np.random.default_rng(0))
    assert length_m >= 500 and len(set(roads)) == len(roads)


def test_a_car_that_strays_keeps_its_way_and_finds_it_again() -> None:
    world = make_world("urban_grid", 1, control="steering", vehicles=1, connected_cars=1, pedestrians=0)
    row = world.fleet.rows[world._traffic.connected[0]]
    at = row["x"].copy(), row["y"].copy()
    row["speed"] = 0.0
    row["x"] += 25.0 * np.sin(row["heading"])
    row["y"] -= 25.0 * np.cos(row["heading"])
    world.step(DT_S, {"cav_0": (-8.0, 0.0)})
    route = world.car_ahead("cav_0").route
    assert np.hypot(*route.points[0]) == pytest.approx(25.0, abs=1.0) and row["astray"]
    row["x"], row["y"] = at
    world.step(DT_S, {"cav_0": (-8.0, 0.0)})
    assert not row["astray"] and row["route_length"] > 1
    assert np.hypot(*world.car_ahead("cav_0").route.points[0]) < 1.0


@pytest.mark.parametrize("wrong", [None, 300, (300,), (300, 200), (0, 100), (100, 1e9), ("a", "b"), (np.nan, 300)])
def test_wrong_distances_are_refused(wrong: object) -> None:
    with pytest.raises(InvalidValueError, match="route_m must be two distances"):
        checked_route(wrong)
