"""Cars that are steered move as bicycles do, by closed forms, and everybody reacts to them wherever they are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from worlds import DT_S, make_world

from coopsim.types.driving import LARGEST_STEERING_RAD
from coopsim.world.traffic.fleet import STEERED, VEHICLE
from coopsim.world.traffic.steered import DRY, STEERING_RAD_S, WET, actuate, roll
from coopsim.world.world import World

GRAVITY_M_S2 = 9.81
HALF_M = 1.3  # of the wheelbase


def car(speed: float, wheel: float = 0.0, acceleration: float = 0.0, grip: float = DRY) -> NDArray[Any]:
    row = np.zeros(1, VEHICLE)
    row["driver"], row["length"], row["width"], row["axle_m"] = STEERED, 4.5, 1.8, HALF_M
    row["speed"], row["wheel"], row["acceleration"], row["grip"] = speed, wheel, acceleration, grip
    return row


def rolled(row: NDArray[Any], steps: int, dt_s: float = DT_S) -> NDArray[np.float64]:
    places = [(float(row["x"][0]), float(row["y"][0]))]
    for _ in range(steps):
        roll(row[0], dt_s)
        places.append((float(row["x"][0]), float(row["y"][0])))
    return np.array(places)


def radius_of(places: NDArray[np.float64]) -> float:
    """Return the radius of the circle through three places, m."""
    a, b, c = places[0], places[len(places) // 2], places[-1]
    sides = [float(np.hypot(*(one - other))) for one, other in ((a, b), (b, c), (c, a))]
    area = abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0]) / 2
    return math.prod(sides) / (4 * area)


@pytest.mark.parametrize("wheel", [0.05, 0.3, -0.6])
@pytest.mark.parametrize("dt_s", [0.02, 0.1])
def test_a_turned_wheel_makes_a_circle_of_ackermanns_radius(wheel: float, dt_s: float) -> None:
    places = rolled(car(3.0, wheel), 40, dt_s)
    behind = 2 * HALF_M / math.tan(wheel)  # of the rear axle
    assert radius_of(places) == pytest.approx(math.hypot(behind, HALF_M), rel=0.01)
    assert math.copysign(1.0, places[-1, 1]) == math.copysign(1.0, wheel)  # positive to the left


@pytest.mark.parametrize(("grip", "braking"), [(DRY, 8.0), (WET, WET * GRAVITY_M_S2), (0.2, 0.2 * GRAVITY_M_S2)])
def test_the_way_of_a_full_brake_is_the_closed_form(grip: float, braking: float) -> None:
    row = car(15.0, grip=grip)
    places = []
    for _ in range(90):
        row["acceleration"] = -8.0
        places = rolled(row, 1)
    assert places[-1, 0] == pytest.approx(15.0**2 / (2 * braking), rel=0.01)
    assert row["speed"][0] == 0.0


def test_a_car_that_is_too_fast_for_a_bend_goes_wide_by_friction() -> None:
    places = rolled(car(20.0, 0.4, grip=0.2), 20)
    assert radius_of(places) == pytest.approx(20.0**2 / (0.2 * GRAVITY_M_S2), rel=0.01)


def test_braking_takes_the_grip_that_a_bend_would_need() -> None:
    coasting, braking = car(15.0, 0.3), car(15.0, 0.3, acceleration=-8.0)
    rolled(coasting, 1)
    rolled(braking, 1)
    assert abs(braking["heading"][0]) < 0.5 * abs(coasting["heading"][0])


def test_front_wheels_lag_and_turn_no_faster_than_they_can() -> None:
    row, angles = car(5.0), [0.0]
    for _ in range(60):
        actuate(row[0], 0.0, LARGEST_STEERING_RAD, DT_S)
        angles.append(float(row["wheel"][0]))
    turned = np.diff(angles)
    assert turned.max() == pytest.approx(STEERING_RAD_S * DT_S) and (turned >= 0).all()
    assert angles[-1] == pytest.approx(LARGEST_STEERING_RAD, rel=0.01) and angles[10] < 0.45


def steered_world(place: str = "crossing", seed: int = 3, **numbers: Any) -> World:
    return make_world(place, seed, control="steering", **{"connected_cars": 1} | numbers)


def row_of(world: World) -> Any:
    (k,) = np.flatnonzero(world.fleet.rows["driver"] == STEERED)
    return world.fleet.rows[k]


def test_a_car_can_leave_the_road_and_asks_for_nothing_there() -> None:
    world = steered_world("highway", vehicles=1)
    start, row = row_of(world)["y"], row_of(world)
    for _ in range(40):
        world.step(DT_S, {"cav_0": (0.0, -0.1)})
    assert abs(row["y"] - start) > 12 and row["astray"] and not row["against"]
    assert row["ticket"] == -1


def test_a_car_that_turns_round_goes_the_wrong_way() -> None:
    world = steered_world(vehicles=1)
    row = row_of(world)
    assert not world.car_ahead("cav_0").wrong_way
    row["heading"] += math.pi
    world.step(DT_S, {"cav_0": (0.0, 0.0)})
    assert world.car_ahead("cav_0").wrong_way
    assert row["speed"] > 0


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, math.pi, 0.7])
def test_drivers_stop_for_a_car_that_stands_in_their_lane_however_it_stands(angle: float) -> None:
    world = steered_world("crossing", seed=0, vehicles=2)
    steered, (other,) = row_of(world), [k for k in range(2) if world.fleet.rows["driver"][k] != STEERED]
    driver = world.fleet.rows[other]
    ahead = 40.0
    steered["x"] = driver["x"] + ahead * math.cos(driver["heading"])
    steered["y"] = driver["y"] + ahead * math.sin(driver["heading"])
    steered["heading"], steered["speed"] = driver["heading"] + angle, 0.0
    for _ in range(120):
        world.step(DT_S, {"cav_0": (0.0, 0.0)})
    assert not driver["crashed"] and driver["speed"] < 0.5


@pytest.mark.parametrize(("aside_m", "brakes"), [(3.2, True), (8.0, False)])
def test_drivers_on_a_highway_see_the_tail_of_a_car_that_stands_across(aside_m: float, brakes: bool) -> None:
    world = steered_world("highway", seed=1, vehicles=2)
    steered, (other,) = row_of(world), [k for k in range(2) if world.fleet.rows["driver"][k] != STEERED]
    driver = world.fleet.rows[other]
    outer = max(range(3), key=lambda k: abs(world._traffic._layout.network.get_lane(_lane(world, driver, k)).start[1]))
    lane = world._traffic._layout.network.get_lane(_lane(world, driver, outer))
    away = math.copysign(1.0, lane.start[1])
    driver["y"], driver["speed"] = lane.start[1], 20.0
    driver["lane"] = driver["target_lane"] = world._traffic._network.lane_number[_lane(world, driver, outer)]
    steered["x"] = driver["x"] + 60.0 * math.cos(driver["heading"])
    steered["y"], steered["heading"], steered["speed"] = lane.start[1] + away * aside_m, math.pi / 2, 0.0
    world.step(DT_S, {"cav_0": (0.0, 0.0)})
    assert (driver["acceleration"] < -1.0) == brakes


def _lane(world: World, driver: Any, number: int) -> tuple[str, str, int]:
    start, end, _ = world._traffic._network.lane_index[driver["lane"]]
    return start, end, number


def test_a_car_beside_the_road_blocks_no_junction() -> None:
    waits = {}
    for stands in (False, True):
        world = steered_world("crossing", seed=5, vehicles=8, pedestrians=0)
        row = row_of(world)
        row["x"], row["y"], row["heading"], row["speed"] = (9.0, 9.0, 0.8, 0.0) if stands else (500.0, 500.0, 0.0, 0.0)
        for _ in range(300):
            world.step(DT_S, {"cav_0": (-8.0, 0.0)})
        waits[stands] = world.fleet.rows["speed"].copy()
    np.testing.assert_array_equal(waits[False], waits[True])


def test_the_same_seed_and_commands_give_the_same_bits() -> None:
    tables = []
    for _ in range(2):
        world, rng = steered_world("urban_grid", vehicles=6), np.random.default_rng(0)
        for _ in range(50):
            world.step(DT_S, {"cav_0": (float(rng.uniform(-3, 3)), float(rng.uniform(-0.6, 0.6)))})
        tables.append(world.fleet.rows.tobytes())
    assert tables[0] == tables[1]
