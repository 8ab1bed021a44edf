"""What a car tells of its motion is what it will do by its own route, and receivers place it in their own frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.comms import ReceivedIntents, ReceivedLights
from coopsim.comms.codecs.asn1 import station_id
from coopsim.comms.codecs.maneuvers import decode_denm, decode_mcm, encode_denm, encode_mcm
from coopsim.comms.intent_broadcast import IntentBroadcast, planned_path
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, Observation, Odometry, PoseEstimate
from coopsim.types.driving import CarState, Route
from coopsim.types.intents import HardBrake, Intents, PlannedPath

pytest.importorskip("asn1tools")

NS = 10**9
NORTH = PoseEstimate(np.array([100.0, 50.0, 0.0, np.pi / 2]))
STRAIGHT = np.column_stack([np.arange(101.0), np.zeros(101)])


def car(speed: float, acceleration: float = 0.0, points: Floats = STRAIGHT, limit: Floats | None = None) -> CarState:
    limit = np.full(len(points), 14.0) if limit is None else limit
    return CarState(speed, acceleration, 4.5, 1.9, False, Route(points, 1.0, limit, np.zeros(len(points), np.int64)))


def path(state: CarState) -> PlannedPath:
    return planned_path("cav_1", 3 * NS, state, NORTH)


def test_at_constant_speed_it_goes_straight_on() -> None:
    told = path(car(10.0))
    assert (told.station, told.time_ns, told.step_s, len(told.points)) == (station_id("cav_1"), 3 * NS, 0.2, 21)
    np.testing.assert_allclose(told.points, np.column_stack([np.zeros(21), 2.0 * np.arange(21)]), atol=1e-9)
    np.testing.assert_allclose(told.heading_rad, np.pi / 2)


@pytest.mark.parametrize(("speed", "acceleration"), [(8.0, -4.0), (10.0, 2.0), (20.0, 0.0)])
def test_it_keeps_its_acceleration_until_it_stands_or_the_limit(speed: float, acceleration: float) -> None:
    told, times = path(car(speed, acceleration)), 0.2 * np.arange(21)
    if acceleration > 0:
        assert told.speed_m_s[-1] == 14.0 and told.points[5, 1] == pytest.approx(11.0)
    elif acceleration < 0:
        moving = times <= 2.0
        np.testing.assert_allclose(told.points[moving, 1], 8 * times[moving] - 2 * times[moving] ** 2, atol=1e-9)
        assert told.speed_m_s[-1] == 0.0 and told.points[-1, 1] == pytest.approx(8.0)
    else:  # faster than is allowed: it brakes with ease
        np.testing.assert_allclose(told.speed_m_s[:16], 20 - 2 * times[:16])


def test_it_brakes_for_a_line_ahead_and_follows_bends() -> None:
    red = np.where(np.arange(101) < 25, 14.0, 0.0)
    assert path(car(10.0, limit=red)).speed_m_s[-1] < 5.0 and path(car(10.0, limit=red)).points[-1, 1] < 26.0
    angle = np.arange(101.0) / 20.0  # a circle of 20 m to the left
    told = path(car(10.0, points=20 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])))
    place = told.points[10] - [-20.0, 0.0]  # from its middle, in the world's axes
    assert np.hypot(*place) == pytest.approx(20.0, abs=0.05) and np.arctan2(place[1], place[0]) == pytest.approx(
        1.0, abs=0.02
    )
    assert told.heading_rad[10] == pytest.approx(np.pi / 2 + 1.0, abs=0.05)


def test_beside_its_lane_it_comes_back_within_two_seconds() -> None:
    told = path(car(10.0, points=STRAIGHT + np.array([0.0, 3.5])))
    np.testing.assert_allclose(told.points[[0, 5, 10, 20], 0], [0.0, -1.75, -3.5, -3.5], atol=1e-9)


def test_messages_are_sent_ten_times_a_second_and_warn_while_a_car_brakes_hard() -> None:
    broadcast = IntentBroadcast({"cav_1": ("mcm", "denm"), "rsu_0": ("mcm",)})
    sent = []
    for k, acceleration in enumerate([0.0, -6.0, -6.0, -3.0, -3.0, -2.0, -5.0, -7.0]):
        now = broadcast.messages(k * NS // 20, {"cav_1": car(9.0, acceleration)}, {"cav_1": NORTH})
        sent.append([(message.codec, message.payload) for message in now.get("cav_1", [])])
        assert set(now) <= {"cav_1"}  # a unit does not drive
    assert [[codec for codec, _ in each] for each in sent] == [
        ["mcm"],
        [],
        ["mcm", "denm"],
        [],
        ["mcm", "denm"],
        [],
        ["mcm"],
        [],
    ]
    first, again = (decode_denm(sent[k][1][1]) for k in (2, 4))
    assert (first.number, first.began_ns, again.began_ns, again.time_ns) == (0, NS // 20, NS // 20, NS // 5)
    assert first.heading_rad == pytest.approx(np.pi / 2) and first.speed_m_s == 9.0
    (last,) = broadcast.messages(NS, {"cav_1": car(9.0, -8.0)}, {"cav_1": NORTH})["cav_1"][1:]
    assert decode_denm(last.payload).number == 1
    assert broadcast.messages(2 * NS, {"cav_1": replace(car(0.0), crashed=True)}, {"cav_1": NORTH}) == {}


def heard(time_ns: int, *payloads: bytes) -> Observation:
    pose = PoseEstimate(np.array([100.0, 80.0, 0.0, np.pi]))  # 30 m before the sender, and looks to the west
    return Observation(time_ns, pose, Odometry(np.zeros(4)), Detections.empty(), signals=payloads)


def test_a_receiver_places_ways_in_its_own_frame_and_moves_them_to_now() -> None:
    memory, told = ReceivedIntents(), encode_mcm(path(car(10.0)))
    assert len(memory.now(heard(3 * NS))) == 0
    memory.hear(
        heard(3 * NS + 5 * NS // 10, told, encode_mcm(replace(path(car(2.0)), time_ns=2 * NS)))
    )  # late by 0.5 s
    intents = memory.now(heard(3 * NS + 5 * NS // 10))
    assert intents.station.tolist() == [station_id("cav_1")] and intents.speed_m_s.tolist() == [10.0]
    places = intents.at(np.array([0.0, 1.0, 3.5, 9.0]))[:, 0]
    np.testing.assert_allclose(places[:, 0], 0.0, atol=0.02)
    np.testing.assert_allclose(places[:, 1], [25.0, 15.0, -10.0, -10.0], atol=0.02)  # 30 m, less what it has moved
    np.testing.assert_allclose(places[:, 2], -np.pi / 2, atol=1e-3)
    assert intents.length_m.tolist() == [4.5] and not intents.hard_brake.any()
    memory.hear(heard(4 * NS + 1))
    assert len(memory.now(heard(4 * NS + 1))) == 0  # after a second


def test_short_ways_of_others_go_on_straight() -> None:
    memory = ReceivedIntents()
    memory.hear(heard(3 * NS, encode_mcm(replace(path(car(10.0)), **short(path(car(10.0)))))))
    assert memory.now(heard(3 * NS)).at(np.array([2.0]))[0, 0, 1] == pytest.approx(10.0, abs=0.03)


def short(told: PlannedPath) -> dict[str, Floats]:
    return {name: getattr(told, name)[:3] for name in ("points", "heading_rad", "speed_m_s")}


def test_warnings_belong_to_their_senders_and_end() -> None:
    memory, brake = ReceivedIntents(), HardBrake(station_id("cav_1"), 0, 3 * NS, 3 * NS, np.zeros(3), 0.0, 9.0)
    other = replace(brake, station=7)
    for time_ns, warned in ((3 * NS, True), (5 * NS, True), (5 * NS + NS // 10, False)):
        way = encode_mcm(replace(path(car(10.0)), time_ns=time_ns))
        memory.hear(heard(time_ns, way, *[encode_denm(each) for each in (brake, other) if time_ns == 3 * NS]))
        assert memory.now(heard(time_ns)).hard_brake.tolist() == [warned]


def test_what_cannot_be_read_is_counted_and_lights_are_passed_over() -> None:
    memory, lights, told = ReceivedIntents(), ReceivedLights(), encode_mcm(path(car(10.0)))
    observation = heard(3 * NS, told[:-1], b"\2\1\0", b"\2\4\0", b"")
    memory.hear(observation)
    lights.hear(observation)
    assert memory.rejected == 2 and lights.rejected == 2  # the third and the fourth
    assert decode_mcm(told).points.shape == (21, 2)


def test_shapes_of_intents_are_checked() -> None:
    with pytest.raises(InvalidValueError, match="station must have shape"):
        replace(Intents.empty(), station=np.zeros(2, np.int64))
