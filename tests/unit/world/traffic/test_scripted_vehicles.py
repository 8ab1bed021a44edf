"""Vehicles of a script start where it says and keep to their manner."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import make_models
from coopsim.world.places.crossings import make_crossing
from coopsim.world.places.highway import make_highway
from coopsim.world.places.layout import Layout
from coopsim.world.population import Population
from coopsim.world.script import Script, VehicleRole
from coopsim.world.traffic.fleet import BODY
from coopsim.world.traffic.traffic import Traffic

DT_S = 0.1
NOBODY = np.zeros(0, BODY)
AHEAD = (("far2", "near2"), ("near2", "stop2"), ("stop2", "exit0"), ("exit0", "bend0"))
ACROSS = (("far1", "near1"), ("near1", "stop1"), ("stop1", "exit3"), ("exit3", "bend3"))


def ego(speed_m_s: float = 8.0, along_m: float = 60.0, route: Any = AHEAD, manner: str = "usual") -> VehicleRole:
    return VehicleRole("cav_0", (*route[0], 0), along_m, speed_m_s, route, connected=True, manner=manner)


def across(manner: str, along_m: float = 50.0, speed_m_s: float = 9.0) -> VehicleRole:
    return VehicleRole("other", (*ACROSS[0], 0), along_m, speed_m_s, ACROSS, manner=manner, conflicts=True)


def traffic_of(*roles: VehicleRole, layout: Layout | None = None, control: str = "traffic", seed: int = 0) -> Traffic:
    script = Script(roles[0], tuple(roles[1:]), (), 20.0)
    population = Population(connected_cars=1, pedestrians=0)
    return Traffic(layout or make_crossing(), population, make_models(), seed, control=control, script=script)


def states(traffic: Traffic, steps: int, people: NDArray[Any] = NOBODY, command: float | None = None) -> Iterable[Any]:
    for _ in range(steps):
        traffic.step(DT_S, {} if command is None else {0: command}, people)
        yield traffic.fleet.rows.copy()


def test_a_script_puts_vehicles_where_it_says_in_place_of_drawn_ones() -> None:
    parked = VehicleRole("truck", (*AHEAD[0], 0), 20.0, label=ObjectClass.TRUCK, manner="parked", aside_m=-3.5)
    traffic = traffic_of(ego(), across("usual"), parked)
    rows, lane = traffic.fleet.rows, make_crossing().network.get_lane((*AHEAD[0], 0))
    assert len(rows) == 3 and rows["id"].tolist() == [1, 2, 3]
    np.testing.assert_allclose((rows["x"][0], rows["y"][0]), lane.position(60.0, 0.0))
    np.testing.assert_allclose((rows["x"][2], rows["y"][2]), lane.position(20.0, -3.5))
    assert rows["speed"].tolist() == [8.0, 9.0, 0.0] and rows["length"][2] > 6
    assert traffic.connected == (0,)
    for after in states(traffic, 40):
        assert (after["x"][2], after["y"][2]) == (rows["x"][2], rows["y"][2])


@pytest.mark.parametrize(("manner", "stops"), [("usual", True), ("unyielding", False), ("steady", False)])
def test_only_a_usual_vehicle_stops_at_the_line_for_one_that_asked_first(manner: str, stops: bool) -> None:
    traffic = traffic_of(ego(3.0, 75.0, manner="steady"), across(manner, 45.0))
    speeds = np.array([rows["speed"] for rows in states(traffic, 80)])
    assert speeds[:, 1].min() < 2.0 if stops else speeds[:, 1].min() > 8.9


def test_an_unyielding_vehicle_brakes_behind_others_and_a_steady_one_does_not() -> None:
    still = VehicleRole("still", ("far1", "near1", 0), 70.0, manner="parked")
    behind = {manner: traffic_of(ego(), across(manner, 10.0), still) for manner in ("unyielding", "steady")}
    last = {manner: list(states(traffic, 100))[-1] for manner, traffic in behind.items()}
    assert not last["unyielding"]["crashed"].any() and last["unyielding"]["speed"][1] < 0.5
    assert last["steady"]["crashed"].tolist() == [False, True, True]


def test_a_driven_car_that_takes_no_notice_is_crashed_into() -> None:
    traffic = traffic_of(ego(9.0, 50.0), across("unyielding", 50.0), control="acceleration")
    crashed = np.array([rows["crashed"] for rows in states(traffic, 80, command=0.0)])
    assert crashed[-1].tolist() == [True, True] and not crashed[10].any()


@pytest.mark.parametrize("ahead_m", [12.0, 0.0])
def test_a_crash_with_a_person_is_noticed_whoever_hits_whom(ahead_m: float) -> None:
    traffic = traffic_of(ego(0.0 if ahead_m == 0.0 else 8.0), control="acceleration")
    x, y, heading = (traffic.fleet.rows[name][0] for name in ("x", "y", "heading"))
    person = np.zeros(1, BODY)
    person["length"] = person["width"] = 0.5
    person["x"], person["y"] = x + ahead_m * np.cos(heading), y + ahead_m * np.sin(heading)
    if ahead_m == 0.0:  # walks into the standing car's side
        person["y"] += 3.0
        person["heading"], person["speed"] = -np.pi / 2, 1.4
    for _ in range(20):
        traffic.step(DT_S, {0: 0.0}, person)
        person["y"] += np.sin(person["heading"]) * person["speed"] * DT_S
    assert traffic.fleet.rows["crashed"][0]


def test_a_usual_driver_brakes_for_a_driven_car_that_comes_towards_it_in_its_lane() -> None:
    wrong_way = (("far0", "near0"), ("near0", "stop0"), ("stop0", "exit2"), ("exit2", "bend2"))
    oncoming = VehicleRole("oncoming", ("exit0", "bend0", 0), 10.0, 8.0, (("exit0", "bend0"), ("bend0", "end0")))
    driven = VehicleRole("cav_0", (*wrong_way[0], 0), 10.0, 4.0, wrong_way, connected=True, aside_m=4.0)
    traffic = traffic_of(driven, oncoming, control="acceleration")
    traffic.fleet.rows["lateral_gain"][0] = 0.0  # stays in the oncoming lane
    speeds = np.array([rows["speed"][1] for rows in states(traffic, 70, command=0.0)])
    assert speeds.min() < 3.0


def highway_roles(trigger_m: float) -> tuple[VehicleRole, ...]:
    lane, road = ("east_start", "east_end", 1), (("east_start", "east_end"),)
    return (
        VehicleRole("cav_0", lane, 2000.0, 22.0, road, connected=True),
        VehicleRole("van", lane, 2030.0, 22.0, road, ObjectClass.VAN, "leaves lane", trigger_m=trigger_m),
        VehicleRole("end", lane, 2150.0, label=ObjectClass.CAR, manner="parked", conflicts=True),
    )


def test_a_cut_out_stays_in_its_lane_until_the_obstacle_is_near_and_then_passes_it() -> None:
    traffic = traffic_of(*highway_roles(45.0), layout=make_highway())
    start_y, gaps, aside = traffic.fleet.rows["y"][1], [], []
    for rows in states(traffic, 80):
        gaps.append(rows["x"][2] - rows["x"][1] - (rows["length"][1] + rows["length"][2]) / 2)
        aside.append(rows["y"][1] - start_y)
    assert max(abs(y) for y, gap in zip(aside, gaps, strict=True) if gap > 46) < 0.05
    assert aside[-1] == pytest.approx(4.0, abs=0.3) and gaps[-1] < -10
    assert not traffic.fleet.rows["crashed"][1]


def test_one_role_more_and_a_connected_one_change_no_other_vehicle() -> None:
    few = traffic_of(ego(), across("usual"), seed=5)
    connected = VehicleRole("third", ("far3", "near3", 0), 20.0, 8.0, connected=True)
    many = traffic_of(ego(), across("usual"), connected, seed=5)
    assert many.connected == (0, 2)
    np.testing.assert_array_equal(few.fleet.rows[:2], many.fleet.rows[:2])


def test_a_second_run_gives_the_same_bits() -> None:
    runs = [list(states(traffic_of(*highway_roles(40.0), layout=make_highway(), seed=3), 60)) for _ in range(2)]
    np.testing.assert_array_equal(np.array(runs[0]), np.array(runs[1]))


def test_the_reference_engine_refuses_scripts_in_one_line() -> None:
    script, population = Script(ego(), (), (), 20.0), Population(connected_cars=1, pedestrians=0)
    with pytest.raises(InvalidValueError, match='must be "arrays" where a scenario has a script') as error:
        Traffic(make_crossing(), population, make_models(), 0, engine="highway-env", script=script)
    assert "\n" not in str(error.value)


def test_a_role_may_name_its_model() -> None:
    names = [model.name for model in make_models() if model.label == ObjectClass.TRUCK]
    for name in names:
        truck = VehicleRole("truck", ("far1", "near1", 0), 20.0, label=ObjectClass.TRUCK, manner="parked", model=name)
        traffic = traffic_of(ego(), truck)
        assert make_models()[traffic.fleet.rows["model"][1]].name == name
    with pytest.raises(UnknownNameError, match="model of 'truck'"):
        traffic_of(ego(), replace(truck, model="tank"))
