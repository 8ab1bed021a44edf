"""`route_follower` overtakes where lanes allow it, comes back, evades as a last resort, and passes what stands."""

from __future__ import annotations

import math

import numpy as np
import pytest
from steered_drive import Other, drive

from coopsim.interfaces.planner import make_planner
from coopsim.planning.route_follower import RouteFollower
from coopsim.types.taxonomy import ObjectClass

SLOW = Other(40.0, 0.0, 3.0)


def test_it_overtakes_a_slow_car_on_the_lane_beside_and_comes_back() -> None:
    driven = drive(RouteFollower(), [SLOW], seconds=25.0, beside=(1, 0))
    assert not driven.touched and max(driven.y) > 3.0
    assert driven.x[-1] > 40 + 25 * 3 + 20 and abs(driven.y[-1]) < 0.5


@pytest.mark.parametrize(
    ("others", "options"),
    [
        ([SLOW], {"beside": (0, 0)}),  # there is no lane
        ([SLOW], {"beside": (1, 0), "lasts_m": 60.0}),  # which ends too soon
        ([SLOW, Other(-12.0, 3.5, 12.0), Other(-24.0, 3.5, 12.0)], {"beside": (1, 0), "seconds": 3.0}),  # not safe
        ([Other(60.0, 0.0, 14.0)], {"beside": (1, 1)}),  # nothing is gained
    ],
)
def test_it_keeps_its_lane_where_a_change_is_not_possible_safe_or_worth_it(others: list[Other], options: dict) -> None:  # type: ignore[type-arg]
    driven = drive(RouteFollower(), others, **options)
    assert not driven.touched and np.abs(driven.y).max() < 0.3


def test_it_keeps_its_lane_if_told_so() -> None:
    assert max(drive(make_planner("route_follower(changes_lanes=False)"), [SLOW], beside=(1, 0)).y) < 0.3


def test_it_is_back_or_stands_before_the_lane_ends() -> None:
    row = [Other(float(x), 0.0) for x in range(40, 150, 7)]  # a queue on the lane of the route
    driven = drive(RouteFollower(), row, seconds=30.0, beside=(1, 0), lasts_m=120.0)
    assert not driven.touched and max(driven.y) > 3.0 and 100 < driven.x[-1] < 120


PERSON = Other(14.5, -1.1, label=ObjectClass.PEDESTRIAN, seen_from_s=0.1)


def test_it_steers_around_what_braking_alone_would_hit() -> None:
    assert drive(make_planner("route_follower(evades=False)"), [PERSON], speed=14.0, seconds=3.0).touched
    driven = drive(RouteFollower(), [PERSON], speed=14.0, seconds=3.0, beside=(1, 0))
    assert not driven.touched and max(driven.y) > 0.4


def test_it_brakes_and_keeps_straight_on_where_that_is_enough() -> None:
    driven = drive(RouteFollower(), [Other(20.0, -1.1, label=ObjectClass.PEDESTRIAN, seen_from_s=0.1)], seconds=4.0)
    assert not driven.touched and np.abs(driven.y).max() < 0.1


def test_it_passes_what_stands_partly_in_its_way_after_a_while() -> None:
    beside = Other(15.0, 2.05, yaw=math.pi)
    driven = drive(RouteFollower(), [beside], speed=5.0, seconds=20.0)
    assert not driven.touched and driven.x[-1] > 40 and abs(driven.y[-1]) < 0.2
    ahead = drive(RouteFollower(), [Other(15.0, 0.0)], speed=5.0, seconds=20.0)
    assert not ahead.touched and ahead.x[-1] < 15
