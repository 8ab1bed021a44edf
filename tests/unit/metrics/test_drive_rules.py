"""Scores of routes, and the parts of EPDMS, have the values that paper and pencil give for hand-made drives."""

import math

import numpy as np
import pytest
from drives import CAR, Thing, drive, scored, straight

from coopsim.world.drivable_area import DrivableArea
from coopsim.world.snapshot import RoadMap

STEADY = [0.0] * 20
"""Two seconds at 10 m/s: 20 m."""


def goal(at_m: float):  # type: ignore[no-untyped-def]
    return lambda x: {"goal_m": at_m - x, "length_m": at_m}


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


def test_a_red_light_costs_three_tenths_and_those_of_the_crash_do_not_count() -> None:
    """One is run at 10 m, another at 18 m."""
    reds = {"state": lambda x: {"red_lights": (x >= 9.5) + (x >= 17.5)}}
    values = scored(drive(STEADY[:15], route=goal(20.0), **reds))
    assert values["red_lights"] == 1
    assert values["lights_obeyed"] == values["epdms"] == values["success"] == 0
    assert values["driving_score"] == pytest.approx(70.0)
    twice = scored(drive(STEADY, route=goal(25.0), **reds))
    assert twice["red_lights"] == 2
    assert twice["driving_score"] == pytest.approx(49.0)
    assert scored(drive(STEADY[:9], **reds))["lights_obeyed"] == 100


def test_the_way_off_the_road_does_not_count() -> None:
    values = scored(drive(STEADY, route=goal(25.0), left=lambda x: (x > 14.5, x > 9.5)))
    assert values["route_completion"] == 100
    assert values["driving_score"] == pytest.approx(70.0)  # the last 6 of 20 steps
    assert values["in_drivable_area"] == values["epdms"] == values["success"] == 0


def test_the_way_on_lanes_that_lead_the_other_way_does_not_count() -> None:
    """As CARLA's `OutsideRouteLanesTest` has it; 5 of 20 steps, of which 2 are beside the road, too."""
    values = scored(
        drive(
            STEADY,
            route=goal(25.0),
            state=lambda x: {"wrong_way": 4.5 < x < 9.5},
            left=lambda x: (7.5 < x < 9.5, False),
        )
    )
    assert values["driving_score"] == pytest.approx(75.0)
    assert values["success"] == 0
    assert scored(drive(STEADY, route=goal(25.0)))["success"] == 100


def test_metres_against_the_traffic_count_within_a_second() -> None:
    directions = [
        scored(drive(STEADY, state=lambda x, long=long: {"wrong_way": 4.5 < x < 4.5 + long}))["right_direction"]
        for long in (1.1, 5.1, 6.1)
    ]
    assert directions == [100, 50, 0]


def test_epdms_weighs_progress_time_lane_and_comfort_five_five_two_two() -> None:
    values = scored(drive(STEADY, limits=lambda x: 20.0))
    assert values["epdms"] == pytest.approx((5 * 50 + 5 * 100 + 2 * 100 + 2 * 100) / 14)
    near = scored(drive(STEADY, [Thing(CAR, straight(28.0, 0.0, 0.0, 0.0))], limits=lambda x: 20.0))
    assert near["min_ttc"] == pytest.approx(0.35, abs=0.01)  # 3.5 m are left in the last frame
    assert near["ttc_in_bound"] == 0
    assert near["epdms"] == pytest.approx((5 * 50 + 2 * 100 + 2 * 100) / 14)


def test_who_comes_from_behind_or_meets_a_standing_car_breaks_no_bound_of_time() -> None:
    behind = scored(drive(STEADY, [Thing(CAR, straight(-24.0, 0.0, 19.0, 0.0))]))
    assert behind["min_ttc"] < 0.5 and behind["ttc_in_bound"] == 100
    rammed = scored(drive(STEADY, [Thing(CAR, straight(-22.4, 0.0, 19.0, 0.0))], crashed=True))
    assert rammed["min_ttc"] == 0 and rammed["ttc_in_bound"] == 100
    met = scored(drive(STEADY, [Thing(CAR, straight(24.0, 0.0, -9.0, 0.0))], speed=0.0, limits=lambda x: 10.0))
    assert met["min_ttc"] < 0.5 and met["ttc_in_bound"] == 100


def beside_lane(*stretches_m: tuple[float, float]) -> float:
    """Return how long a lane is kept that is 0.6 m to the left of the car in stretches, and else below it, per cent."""
    within = lambda x: any(first - 0.5 < x < last - 0.5 for first, last in stretches_m)  # noqa: E731
    return scored(drive([0.0] * 99, way_m=lambda x: 0.6 * within(x)))["lane_kept"]


def test_a_lane_is_not_kept_half_a_metre_beside_its_middle_for_two_seconds() -> None:
    assert beside_lane((10, 29)) == 100
    assert beside_lane((10, 30)) == pytest.approx(80.0)
    assert beside_lane((10, 29), (31, 56)) == pytest.approx(75.0)
    assert scored(drive([0.0] * 99, way_m=lambda x: 0.45))["lane_kept"] == 100


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
