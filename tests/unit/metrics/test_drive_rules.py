"""Scores of routes, and the parts of EPDMS, have the values that paper and pencil give for hand-made drives."""

import math

import numpy as np
import pytest
from drives import CAR, Thing, drive, scored, straight

from coopsim.types.driving import GREEN, RED
from coopsim.world.drivable_area import DrivableArea
from coopsim.world.snapshot import RoadMap

STEADY = [0.0] * 20
"""Two seconds at 10 m/s: 20 m."""


def goal(at_m: float):  # type: ignore[no-untyped-def]
    return lambda x: {"goal_m": at_m - x, "length_m": at_m}


def line(at_m: float, colour: int):  # type: ignore[no-untyped-def]
    """Return a light of a colour behind a line, over a junction of 20 m."""

    def lights(x: float) -> dict[str, object]:
        place = x + np.arange(101)
        return {"lights": np.where((place >= at_m) & (place < at_m + 20), colour, 0)}

    return lights


def test_a_drive_without_a_goal_has_neither_completion_nor_success_and_its_score_is_its_progress() -> None:
    values = scored(drive(STEADY))
    assert math.isnan(values["route_completion"])
    assert math.isnan(values["success"])
    assert values["driving_score"] == values["progress"] == pytest.approx(100.0)


def test_half_of_a_way_is_half_of_the_score() -> None:
    values = scored(drive(STEADY, route=goal(40.0)))
    assert values["route_completion"] == values["driving_score"] == pytest.approx(50.0)
    assert values["success"] == 0


def test_a_goal_is_reached_five_metres_before_it() -> None:
    values = scored(drive(STEADY, route=goal(25.0)))
    assert values["route_completion"] == values["driving_score"] == values["success"] == 100
    crashed = Thing(CAR, straight(24.5, 0.0, 0.0, 0.0))
    values = scored(drive(STEADY, [crashed], crashed=True, route=goal(25.0)))
    assert values["success"] == 0
    assert values["driving_score"] == pytest.approx(60 * 19 / 25)  # the last frame before the crash is at 19 m


def test_a_red_light_that_front_and_middle_pass_costs_three_tenths() -> None:
    values = scored(drive(STEADY, route=lambda x: {**goal(25.0)(x), **line(12.0, RED)(x)}))
    assert values["red_lights"] == 1
    assert values["lights_obeyed"] == values["epdms"] == values["success"] == 0
    assert values["driving_score"] == pytest.approx(70.0)


def test_no_red_light_is_run_at_green_nor_by_a_car_that_stops_over_the_line() -> None:
    assert scored(drive(STEADY, route=line(12.0, GREEN)))["red_lights"] == 0
    stops = scored(drive(STEADY, route=line(21.5, RED)))  # the front ends 0.75 m behind the line
    assert stops["red_lights"] == 0
    assert stops["lights_obeyed"] == 100


def test_a_light_that_turns_red_over_the_car_was_not_run() -> None:
    turns = scored(drive(STEADY, route=lambda x: line(12.0, GREEN if x < 11.5 else RED)(x)))
    assert turns["red_lights"] == 0


def test_the_way_off_the_road_does_not_count() -> None:
    values = scored(drive(STEADY, route=goal(25.0), left=lambda x: (x > 14.5, x > 9.5)))
    assert values["route_completion"] == 100
    assert values["driving_score"] == pytest.approx(70.0)  # the last 6 of 20 steps
    assert values["in_drivable_area"] == values["epdms"] == values["success"] == 0


def test_metres_against_the_traffic_count_within_a_second() -> None:
    directions = [
        scored(drive(STEADY, state=lambda x, long=long: {"wrong_way": 4.5 < x < 4.5 + long}))["right_direction"]
        for long in (1.9, 5.9, 9.9)
    ]
    assert directions == [100, 50, 0]


def test_epdms_weighs_progress_time_and_comfort_five_five_two() -> None:
    values = scored(drive(STEADY, limits=lambda x: 20.0))
    assert values["epdms"] == pytest.approx((5 * 50 + 5 * 100 + 2 * 100) / 12)
    near = scored(drive(STEADY, [Thing(CAR, straight(28.0, 0.0, 0.0, 0.0))], limits=lambda x: 20.0))
    assert near["min_ttc"] == pytest.approx(0.35, abs=0.01)  # 3.5 m are left in the last frame
    assert near["ttc_in_bound"] == 0
    assert near["epdms"] == pytest.approx((5 * 50 + 2 * 100) / 12)


def test_a_crash_by_ones_own_fault_leaves_nothing_a_wall_half_and_that_of_another_all() -> None:
    own = scored(drive(STEADY, [Thing(CAR, straight(24.5, 0.0, 0.0, 0.0))], crashed=True))
    wall = scored(drive(STEADY, crashed=True))
    other = Thing(CAR, straight(-13.0, 0.0, 8.6, 0.0))
    hit = scored(drive([0.0] * 10, [other], speed=0.0, crashed=True, limits=lambda x: 10.0))
    assert [values["no_fault"] for values in (own, wall, hit)] == [0, 50, 100]
    assert own["epdms"] == 0
    assert wall["driving_score"] == pytest.approx(65.0)


def test_a_corner_on_a_pavement_leaves_the_area_and_the_middle_beside_the_lanes_leaves_the_road() -> None:
    lane, pavement = np.array([[0, -2], [50, -2], [50, 2], [0, 2.0]]), np.array([[0, 2], [50, 2], [50, 5], [0, 5.0]])
    area = DrivableArea(RoadMap((lane,), (), (pavement,), ()))
    found = [area.left(np.array([20.0, y, 0.0]), 4.0, 2.0) for y in (0.0, 1.5, 2.5)]
    assert found == [(False, False), (False, True), (True, True)]
