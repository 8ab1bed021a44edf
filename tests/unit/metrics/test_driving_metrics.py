"""Metrics of driving have the values that paper and pencil give for hand-made drives."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from drives import CAR, PEDESTRIAN, Thing, drive, scored, straight

from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics import Evaluator, summarize
from coopsim.metrics.built_in import is_yes_no
from coopsim.metrics.driving import DRIVING
from coopsim.types import Tracks

STEADY = [0.0] * 10


def test_without_a_driven_car_there_are_no_metrics_of_driving() -> None:
    assert not set(DRIVING) & set(summarize([Evaluator().log]).values)
    assert set(DRIVING) <= set(scored(drive(STEADY)))


def test_time_to_collision_with_a_standing_car_is_the_gap_over_the_speed() -> None:
    # The gap is 30 m at first and 20 m in the end, at 10 m/s.
    ahead = Thing(CAR, straight(34.5, 0.0, 0.0, 0.0))
    assert scored(drive(STEADY, [ahead]))["min_ttc"] == pytest.approx(2.0, abs=1e-3)


def test_time_to_collision_with_an_oncoming_car_counts_both_speeds() -> None:
    # 40 m at first, 20 m in the end, closing at 20 m/s.
    oncoming = Thing(CAR, straight(44.5, 0.0, -10.0, 0.0), yaw=math.pi)
    assert scored(drive(STEADY, [oncoming]))["min_ttc"] == pytest.approx(1.0, abs=1e-3)


def test_a_car_in_the_other_lane_is_no_danger_and_times_are_cut_at_five_seconds() -> None:
    oncoming = Thing(CAR, straight(44.5, 3.5, -10.0, 0.0), yaw=math.pi)
    parked = Thing(CAR, straight(20.0, -2.5, 0.0, 0.0))
    values = scored(drive([0.0] * 40, [oncoming, parked]))
    assert values["min_ttc"] == values["pet"] == 5.0


def test_a_car_that_turns_off_its_straight_line_in_time_is_no_danger() -> None:
    # It comes along y = 0, and truly leaves the car's lane 2 s before they meet.
    def swerving(t: float) -> tuple[float, float]:
        return 54.5 - 10 * t, min(max(t - 0.5, 0.0) * 10.0, 4.0)

    alone = scored(drive(STEADY, [Thing(CAR, straight(54.5, 0.0, -10.0, 0.0), yaw=math.pi)]))
    turning = scored(drive([0.0] * 30, [Thing(CAR, swerving, yaw=math.pi)]))
    assert alone["min_ttc"] < 2.0
    assert turning["min_ttc"] == 5.0


def test_a_crash_has_its_speed_its_party_and_its_cause() -> None:
    # After 1 s at 10 m/s the car's front is at 12.25 m; the standing car's rear is at 12.2 m.
    values = scored(drive(STEADY, [Thing(CAR, straight(14.45, 0.0, 0.0, 0.0))], crashed=True))
    assert values["crash"] == values["crash_at_fault"] == values["crash_vehicle"] == 100
    assert values["crash_person"] == values["crash_rider"] == 0
    assert values["impact_speed"] == pytest.approx(10.0, abs=1e-3)
    assert values["min_ttc"] == values["pet"] == 0
    assert values["driving_score"] == pytest.approx(60.0, abs=1e-3)


def test_a_car_that_is_hit_from_behind_while_it_stands_crashed_without_fault_and_penalty() -> None:
    behind = Thing(CAR, straight(-13.0, 0.0, 8.6, 0.0))
    values = scored(drive(STEADY, [behind], speed=0.0, crashed=True, limits=lambda x: 0.0))
    assert values["crash"] == 100
    assert values["crash_at_fault"] == 0
    assert values["impact_speed"] == pytest.approx(8.6, abs=1e-3)


def test_the_side_of_a_car_is_hit_by_another() -> None:
    # A car from the right touches the middle of the side after 1 s.
    runner = Thing(CAR, lambda t: (10.0, -3.15 - 8.0 * (1 - t)), yaw=math.pi / 2)
    values = scored(drive(STEADY, [runner], crashed=True))
    assert values["crash"] == 100
    assert values["crash_at_fault"] == 0
    assert values["impact_speed"] == pytest.approx(math.hypot(10, 8), abs=1e-3)


def test_a_person_before_the_front_is_driven_into() -> None:
    person = Thing(PEDESTRIAN, lambda t: (12.4, 1.5 * (t - 1)), yaw=math.pi / 2)
    values = scored(drive(STEADY, [person], crashed=True))
    assert values["crash_at_fault"] == values["crash_person"] == 100
    assert values["driving_score"] == pytest.approx(50.0, abs=1e-3)


def test_post_encroachment_time_of_a_person_who_walks_behind_the_car() -> None:
    # The car's rear leaves the person's way, 0.25 m wide to each side of x = 20, at 22.5 m: after 2.25 s. The person,
    # whose front is 0.25 m ahead, comes to the car's side at y = -0.95 after 4.8 m: 3.2 s.
    person = Thing(PEDESTRIAN, straight(20.0, -6.0, 0.0, 1.5), yaw=math.pi / 2)
    values = scored(drive([0.0] * 50, [person]))
    assert values["pet"] == pytest.approx(0.95, abs=0.11)
    assert values["crash"] == 0
    assert math.isnan(values["impact_speed"])


def test_following_leaves_no_encroachment() -> None:
    leader = Thing(CAR, straight(15.0, 0.0, 10.0, 0.0))
    assert scored(drive([0.0] * 40, [leader]))["pet"] == 5.0


BRAKE = [0.0] * 5 + [-5.0] * 10 + [0.0] * 25
"""A brake of 1 s, 0.5 s after the start at 10 m/s: the car then goes on at 5 m/s."""


def test_a_brake_for_nothing_is_a_phantom_brake() -> None:
    values = scored(drive(BRAKE))
    assert values["phantom_brakes"] == values["hard_brakes"] == 1


def test_a_light_brake_is_neither_hard_nor_a_phantom_brake() -> None:
    values = scored(drive([0.0] * 5 + [-2.0] * 10 + [0.0] * 10))
    assert values["phantom_brakes"] == values["hard_brakes"] == 0


def test_a_brake_between_the_limits_is_a_phantom_brake_but_not_hard() -> None:
    values = scored(drive([0.0] * 5 + [-2.7] * 10 + [0.0] * 10))
    assert values["phantom_brakes"] == 1
    assert values["hard_brakes"] == 0


@pytest.mark.parametrize(
    ("thing", "reason"),
    [
        (Thing(PEDESTRIAN, straight(30.0, -4.5, 0.0, 1.5), yaw=math.pi / 2), True),  # walks into its way
        (Thing(PEDESTRIAN, straight(30.0, -15.0, 0.0, 1.5), yaw=math.pi / 2), False),  # comes 5 s too late
        (Thing(PEDESTRIAN, straight(30.0, -4.5, 1.5, 0.0)), False),  # walks along the road
        (Thing(CAR, straight(24.5, 0.0, 4.0, 0.0)), True),  # drives slowly ahead
        (Thing(CAR, straight(60.0, 0.0, 10.0, 0.0)), False),  # drives as fast, far ahead
        (Thing(CAR, straight(-9.0, 0.0, 10.0, 0.0)), False),  # follows closely
        (Thing(CAR, straight(-10.0, 8.0, 13.0, -2.5), yaw=-0.19), True),  # merges from behind, faster
        (Thing(CAR, straight(-30.0, 3.5, 13.0, 0.0)), False),  # overtakes
        (Thing(CAR, straight(30.0, 3.5, -10.0, 0.0), yaw=math.pi), False),  # comes in its own lane
    ],
)
def test_a_brake_has_a_reason_where_the_car_would_have_met_something_it_sees(thing: Thing, reason: bool) -> None:
    # The report is empty: the car's own sensors see the object.
    assert scored(drive(BRAKE, [thing], tracks=lambda t: Tracks.empty()))["phantom_brakes"] == (not reason)


def test_one_of_several_objects_is_reason_enough() -> None:
    far = [Thing(CAR, straight(-9.0, 0.0, 10.0, 0.0)), *(Thing(CAR, straight(x, 9.0, 0.0, 0.0)) for x in (5.0, 25.0))]
    crossing = Thing(PEDESTRIAN, straight(30.0, -4.5, 0.0, 1.5), yaw=math.pi / 2)
    assert scored(drive(BRAKE, far))["phantom_brakes"] == 1
    assert scored(drive(BRAKE, [*far, crossing]))["phantom_brakes"] == 0


NEVER_S = 99.0
CROSSES, STAYS = straight(30.0, -4.5, 0.0, 1.5), straight(30.0, -15.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("at", "seen_s", "tracked_s", "phantoms"),
    [
        pytest.param(CROSSES, 0.2, NEVER_S, 0, id="in its way and seen"),
        pytest.param(CROSSES, NEVER_S, 0.2, 0, id="in its way and confirmed"),
        pytest.param(CROSSES, 0.8, 0.8, 1, id="in its way and not yet known"),
        pytest.param(STAYS, 0.0, 0.0, 1, id="known and not in its way"),
        pytest.param(STAYS, NEVER_S, NEVER_S, 1, id="neither known nor in its way"),
    ],
)
def test_only_a_known_object_in_its_way_is_a_reason(
    at: Callable[[float], tuple[float, float]], seen_s: float, tracked_s: float, phantoms: int
) -> None:
    # The brake begins in the step after 0.5 s.
    person = Thing(PEDESTRIAN, at, math.pi / 2, seen_s=seen_s, tracked_s=tracked_s)
    assert scored(drive(BRAKE, [person]))["phantom_brakes"] == phantoms


def test_an_object_once_known_stays_a_reason() -> None:
    # A track was on it in the first two frames only.
    person = Thing(PEDESTRIAN, CROSSES, math.pi / 2, seen_s=NEVER_S)

    def tracks(t: float) -> Tracks:
        row = [[30.0 - 10 * t, -4.5 + 1.5 * t, 0.9, 0.5, 0.5, 1.8, math.pi / 2]]
        found = Tracks(np.array([5]), Boxes3D.from_array(row), np.zeros((1, 2)), np.ones(1), np.array([PEDESTRIAN]))
        return found if t < 0.15 else Tracks.empty()

    assert scored(drive(BRAKE, [person], tracks=tracks))["phantom_brakes"] == 0


def test_a_track_of_nothing_is_no_reason_though_someone_unknown_comes() -> None:
    # A false track stands in the lane; the person who comes into the way is 9 m from it, and hidden.
    person = Thing(PEDESTRIAN, CROSSES, math.pi / 2, seen_s=NEVER_S, tracked_s=NEVER_S)

    def tracks(t: float) -> Tracks:
        row = [[21.0 - 10 * t, 0.0, 0.9, 0.5, 0.5, 1.8, 0.0]]
        return Tracks(np.array([5]), Boxes3D.from_array(row), np.zeros((1, 2)), np.ones(1), np.array([PEDESTRIAN]))

    assert scored(drive(BRAKE, [person], tracks=tracks))["phantom_brakes"] == 1


def test_a_brake_for_a_bend_is_no_phantom_brake() -> None:
    assert scored(drive(BRAKE, limits=lambda x: 10.0 if x < 25 else 5.0))["phantom_brakes"] == 0


def test_a_brake_with_a_short_pause_is_one() -> None:
    twice = [-5.0] * 3 + [0.0] * 5 + [-5.0] * 3
    apart = [-5.0] * 3 + [0.0] * 15 + [-5.0] * 3
    assert scored(drive([0.0, *twice, 0.0]))["hard_brakes"] == 1
    assert scored(drive([0.0, *apart, 0.0]))["hard_brakes"] == 2


PERSON = Thing(PEDESTRIAN, straight(30.0, -4.5, 0.0, 1.5), math.pi / 2, seen_s=1.5, tracked_s=0.8, conflicts=True)
"""Crosses so that the car, whose front is at 2.25 + 10 t, would touch it after 2.75 s: its front is then at 29.75 m,
and the person's at y = -0.125."""


def test_lead_times_tell_seen_confirmed_and_braked_apart() -> None:
    values = scored(drive([0.0] * 12 + [-6.0] * 15 + [0.0] * 5, [PERSON]))
    # The first brake is in the frame after 1.2 s.
    assert values["lead_time"] == pytest.approx(2.75 - 0.8, abs=0.11)
    assert values["lead_time_seen"] == pytest.approx(2.75 - 1.5, abs=0.11)
    assert values["lead_time_braked"] == pytest.approx(2.75 - 1.3, abs=0.11)
    assert values["lead_time"] - values["lead_time_seen"] == pytest.approx(0.7)
    assert values["crash"] == values["phantom_brakes"] == 0


def test_the_conflict_does_not_depend_on_when_the_car_brakes() -> None:
    early = scored(drive([0.0] * 9 + [-4.0] * 25, [PERSON]))
    late = scored(drive([0.0] * 17 + [-8.0] * 12, [PERSON]))
    assert early["lead_time"] == pytest.approx(late["lead_time"])
    assert early["lead_time_braked"] - late["lead_time_braked"] == pytest.approx(0.8)


def test_a_brake_before_the_first_track_is_no_reaction() -> None:
    values = scored(drive([0.0, -2.0, -2.0, *[0.0] * 12, *[-6.0] * 12], [PERSON]))
    # Without its first brake the car would have gone on at 10 m/s.
    assert values["lead_time"] == pytest.approx(2.75 - 0.8, abs=0.11)
    assert values["lead_time_braked"] == pytest.approx(2.75 - 1.6, abs=0.11)


def test_a_conflict_that_the_car_avoids_has_lead_times_as_one_that_it_does_not() -> None:
    avoided = scored(drive([0.0] * 9 + [-4.0] * 25, [PERSON]))
    crashed = scored(drive([0.0] * 28, [PERSON], crashed=True))
    assert (avoided["crash"], crashed["crash"]) == (0, 100)
    assert avoided["lead_time"] == pytest.approx(crashed["lead_time"])
    assert avoided["lead_time_seen"] == pytest.approx(crashed["lead_time_seen"])


def test_who_is_never_tracked_leaves_no_lead() -> None:
    nothing = scored(drive([0.0] * 28, [PERSON], crashed=True, tracks=lambda t: Tracks.empty()))
    assert nothing["lead_time"] == nothing["lead_time_braked"] == 0
    assert nothing["lead_time_seen"] == pytest.approx(2.75 - 1.5, abs=0.11)


def test_without_a_conflict_there_is_no_lead_time() -> None:
    assert math.isnan(scored(drive(STEADY, [Thing(CAR, straight(50.0, 3.5, 0.0, 0.0))]))["lead_time"])


def test_a_track_of_something_else_confirms_nothing() -> None:
    # A van stands 1 m from the person's way; tracks on it, of vehicles, near the person, are the van's.
    def reports(label: int, x: float) -> float:
        def tracks(t: float) -> Tracks:
            row = [x - 10 * t, -4.5 + 1.5 * t, 0.9, 0.5, 0.5, 1.8, 0.0]
            return Tracks(np.array([5]), Boxes3D.from_array([row]), np.zeros((1, 2)), np.ones(1), np.array([label]))

        van = Thing(CAR, straight(26.0, -3.0, 0.0, 0.0))
        return scored(drive([0.0] * 28, [PERSON, van], crashed=True, tracks=tracks))["lead_time"]

    assert reports(PEDESTRIAN, 31.5) > 2.5
    assert reports(CAR, 31.5) == 0  # a vehicle
    assert reports(PEDESTRIAN, 32.5) == 0  # more than 2 m away


def test_progress_and_time_lost_compare_with_the_legal_speed() -> None:
    values = scored(drive([0.0] * 100, speed=5.0))
    assert values["progress"] == pytest.approx(50.0, abs=1e-3)
    assert values["time_lost"] == pytest.approx(5.0, abs=1e-3)
    assert values["driving_score"] == pytest.approx(50.0, abs=1e-3)


def test_several_drives_are_averaged_and_undefined_values_left_out() -> None:
    crash = drive(STEADY, [Thing(CAR, straight(14.45, 0.0, 0.0, 0.0))], crashed=True)
    values = scored(crash, drive(STEADY), drive(STEADY), drive(STEADY))
    assert values["crash"] == 25
    assert values["impact_speed"] == pytest.approx(10.0, abs=1e-3)


def test_rates_say_so() -> None:
    crashes = [name for name in DRIVING if name.startswith("crash")]
    others = ["success", "in_drivable_area", "lights_obeyed", "ttc_in_bound"]
    assert [name for name in DRIVING if is_yes_no(name)] == crashes + others
    assert not is_yes_no("MOTA")
    assert not is_yes_no("no such metric")


def test_a_drive_of_one_frame_and_a_crash_in_the_first_frame_have_values() -> None:
    for values in (scored(drive([])), scored(drive([], crashed=True))):
        assert values["crash"] in (0, 100)
        assert math.isnan(values["progress"])
