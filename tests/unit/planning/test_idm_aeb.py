"""The fixed planner drives by what it is told: it stops for what it sees, and crashes into what it does not see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from steered_drive import DT_S, LENGTH_M, WIDTH_M, Other, touches, tracks_of

from coopsim.geometry.boxes import Boxes3D
from coopsim.interfaces.planner import PlannedCar, make_planner
from coopsim.planning.idm_aeb import _predicted
from coopsim.types import Tracks
from coopsim.types.driving import (
    GIVES_WAY,
    HAS_PRIORITY,
    JERK_M_S3,
    LARGEST_ACCELERATION_M_S2,
    LARGEST_BRAKING_M_S2,
    Route,
)
from coopsim.types.taxonomy import ObjectClass


@dataclass
class Drive:
    """What came out: speeds, places along the road and accelerations of the car, and the speed at a crash."""

    speed: list[float]
    along: list[float]
    acceleration: list[float]
    crash_m_s: float | None = None


def drive(
    others: list[Other],
    *,
    speed: float = 10.0,
    seconds: float = 12.0,
    right_of_way: int = 0,
    limit: float = 13.9,
    planner: str = "idm_aeb",
    bend: Callable[[float], float] = lambda along: 0.0,
    traffic_side: str = "right",
) -> Drive:
    """Drive east on y = 0 among others."""
    driver, at, acceleration = make_planner(planner), 0.0, 0.0
    out = Drive([], [], [])
    for k in range(int(seconds / DT_S)):
        time_s = k * DT_S
        if touches(others, time_s, at) and out.crash_m_s is None:
            out.crash_m_s = speed
        tracks = tracks_of(others, time_s, at)
        along = np.arange(121.0)
        limits = np.array([limit if bend(at + each) == 0 else bend(at + each) for each in along])
        route = Route(np.column_stack([along, np.zeros(121)]), 1.0, limits, np.full(121, right_of_way))
        size = LENGTH_M, WIDTH_M
        car = PlannedCar(
            "cav_0", round(time_s * 1e9), DT_S, tracks, speed, acceleration, 0.0, *size, route, traffic_side
        )
        wanted = float(np.clip(driver.plan(car), -LARGEST_BRAKING_M_S2, LARGEST_ACCELERATION_M_S2))
        acceleration += float(np.clip(wanted - acceleration, -JERK_M_S3 * DT_S, JERK_M_S3 * DT_S))
        speed = max(speed + acceleration * DT_S, 0.0)
        at += speed * DT_S
        out.speed.append(speed)
        out.along.append(at)
        out.acceleration.append(acceleration)
    return out


def test_on_a_free_road_it_reaches_the_limit_and_keeps_it() -> None:
    out = drive([], speed=3.0, seconds=60)
    assert 13.0 < out.speed[-1] <= 13.9
    assert max(out.acceleration) <= 1.01


def test_it_is_slow_enough_where_a_bend_begins() -> None:
    out = drive([], speed=13.0, seconds=30, bend=lambda along: 5.0 if 80 < along < 110 else 0.0)
    within = [speed for speed, along in zip(out.speed, out.along, strict=True) if 82 < along < 110]
    assert within and max(within) < 6.0
    assert min(out.acceleration) > -3.0


@pytest.mark.parametrize("speed", [5.0, 10.0, 13.9])
def test_it_stops_with_ease_before_a_standing_object_that_it_sees(speed: float) -> None:
    out = drive([Other(60.0, 0.0)], speed=speed, seconds=40)
    assert out.crash_m_s is None and out.speed[-1] < 0.1
    gap = 60.0 - 2.25 - (out.along[-1] + 2.25)
    assert 1.0 < gap < 3.0
    assert min(out.acceleration) > -4.0


def test_it_crashes_into_what_it_does_not_see() -> None:
    out = drive([Other(60.0, 0.0, seen_from_s=1e9)], speed=10.0)
    assert out.crash_m_s is not None and out.crash_m_s > 10


def test_it_follows_a_slower_vehicle_at_its_speed() -> None:
    out = drive([Other(40.0, 0.0, vx=7.0)], speed=12.0, seconds=40)
    assert out.crash_m_s is None and out.speed[-1] == pytest.approx(7.0, abs=0.3)
    gap = 40.0 + 7.0 * 40 - 4.5 - out.along[-1]
    assert 7.0 < gap < 14.0  # IDM: 2 m and 1 s, and a little more below the limit


def test_what_stands_or_drives_beside_the_road_is_not_in_the_way() -> None:
    beside = [
        Other(30.0, 3.5),
        Other(10.0, -3.5, vx=9.0),
        Other(80.0, 3.5, vx=-10.0),
        Other(40.0, 2.6, label=ObjectClass.PEDESTRIAN),
    ]
    free, out = drive([]), drive(beside)
    np.testing.assert_allclose(out.speed, free.speed)


def test_a_late_sight_makes_it_brake_hard_and_lessens_the_impact() -> None:
    """Full braking from 11 m/s takes 8 m, and what it drives in the 0.4 s before."""
    seen = drive([Other(30.0, 0.0, label=ObjectClass.PEDESTRIAN, seen_from_s=1.8)], speed=10.0)
    blind = drive([Other(30.0, 0.0, label=ObjectClass.PEDESTRIAN, seen_from_s=1e9)], speed=10.0)
    assert min(seen.acceleration) == pytest.approx(-LARGEST_BRAKING_M_S2)
    assert blind.crash_m_s is not None
    assert seen.crash_m_s is None or seen.crash_m_s < blind.crash_m_s / 2


def test_it_yields_to_a_pedestrian_who_will_cross_and_goes_on_behind() -> None:
    walker = Other(45.0, -6.0, vy=1.5, label=ObjectClass.PEDESTRIAN)
    out = drive([walker], speed=9.0, seconds=25)
    assert out.crash_m_s is None
    assert min(out.speed) < 7.0 and out.along[-1] > 60
    assert min(out.acceleration) > -LARGEST_BRAKING_M_S2


def test_it_waits_for_crossing_traffic_where_it_gives_way() -> None:
    crossing = Other(40.0, -40.0, vy=10.0)
    out = drive([crossing], speed=10.0, seconds=25, right_of_way=GIVES_WAY)
    assert out.crash_m_s is None and min(out.speed) < 8.0


@pytest.mark.parametrize("vy", [-4.0, -1.5])
def test_it_stops_clear_of_a_track_that_comes_across_its_way_and_towards_it(vy: float) -> None:
    assert drive([Other(71, -3 * vy, vx=-12, vy=vy)], right_of_way=GIVES_WAY).crash_m_s is None


def test_it_lets_a_faster_track_merge_that_would_be_beside_it() -> None:
    out = drive([Other(-12, 8, vx=14, vy=-2.5)], right_of_way=GIVES_WAY, seconds=5.0)
    assert out.crash_m_s is None and min(out.acceleration) > -6


def test_with_priority_it_goes_on_while_the_other_can_still_stop() -> None:
    far = Other(28.0, -26.0, vy=8.0)
    yielding, priority = (
        drive([far], speed=10.0, seconds=0.7, right_of_way=side) for side in (GIVES_WAY, HAS_PRIORITY)
    )
    assert min(priority.acceleration) > min(yielding.acceleration)


@pytest.mark.parametrize(("traffic_side", "first"), [("right", -1), ("left", 1)])
def test_where_nobody_has_the_right_of_way_the_outer_side_goes_first(traffic_side: str, first: int) -> None:
    """At the same time come a car on the outer side, whom it lets pass, and one on the inner side, who waits."""
    waits, goes = (
        drive([Other(28.0, side * 24.0, vy=side * -8.0)], seconds=0.7, right_of_way=0, traffic_side=traffic_side)
        for side in (first, -first)
    )
    assert min(waits.acceleration) < -0.3 and min(goes.acceleration) > min(waits.acceleration) + 0.3


def test_with_priority_it_still_brakes_for_one_that_does_not_stop() -> None:
    runner = Other(40.0, -32.0, vy=8.0)
    out = drive([runner], speed=10.0, seconds=20, right_of_way=HAS_PRIORITY)
    assert out.crash_m_s is None


def test_a_false_track_on_the_road_makes_it_brake_for_nothing() -> None:
    """The price of false tracks: phantom brakes."""
    out = drive([Other(30.0, 0.0, seen_from_s=1.5)], speed=10.0, seconds=4.0)
    assert min(out.acceleration) < -3.0


@pytest.mark.parametrize("setting", ["headway_s=0", "margin_m=-1", "horizon_s=nan"])
def test_wrong_settings_are_refused(setting: str) -> None:
    with pytest.raises(Exception, match=setting.split("=")[0]):
        make_planner(f"idm_aeb({setting})")


def test_it_stands_before_a_red_light() -> None:
    out = drive([], speed=10.0, seconds=60, bend=lambda along: -1e-9 if along >= 60 else 13.9)  # any limit of 0 or less
    assert 58 < out.along[-1] < 61 and out.speed[-1] == 0 and min(out.acceleration) > -3.5


def test_who_turns_is_predicted_on_its_circle() -> None:
    """Its places are on a circle with the radius v / w, and it heads along it; who does not turn goes on straight."""
    speed, rate, times = 8.0, np.array([0.5, -0.5, 0.0]), np.array([0.0, 0.7, 2.0])
    boxes = Boxes3D.from_array(np.tile([3.0, -1.0, 0.8, 4.5, 1.9, 1.6, 0.0], (3, 1)))
    heading_along_x = np.tile([speed, 0.0], (3, 1))
    tracks = Tracks(np.arange(3), boxes, heading_along_x, np.ones(3), np.zeros(3, int))
    center, heading = _predicted(tracks, heading_along_x, rate, times)
    for k, each in enumerate(rate[:2]):
        radius, angle = speed / each, each * times
        circle = np.column_stack([3.0 + radius * np.sin(angle), -1.0 + radius * (1 - np.cos(angle))])
        np.testing.assert_allclose(center[:, k], circle, atol=1e-9)
        np.testing.assert_allclose(heading[:, k], angle, atol=1e-12)
    np.testing.assert_allclose(center[:, 2], np.column_stack([3.0 + speed * times, np.full(3, -1.0)]), atol=1e-9)
