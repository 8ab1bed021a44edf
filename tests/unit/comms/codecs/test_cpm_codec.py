"""ETSI's message comes back within the standard's units, and its bits are those that X.691 gives."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from codec_samples import some_detections, some_perception
from hypothesis import given, settings
from hypothesis import strategies as st
from unaligned_bits import bits

from coopsim.comms.codecs.codec import decoder
from coopsim.comms.codecs.cpm_codec import CollectivePerception, CpmCodec, messages
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.uplink import named_uplink
from coopsim.errors import CodecError, MissingDependencyError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import wrap_angle
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate
from coopsim.types.taxonomy import ObjectClass

CODEC = CpmCodec()
CHILD, PEDESTRIAN = int(ObjectClass.CHILD), int(ObjectClass.PEDESTRIAN)


def number(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most, allow_nan=False)


OBJECT = st.tuples(
    *[number(-926, 926)] * 2, number(-1310, 1310), *[number(1e-9, 25.4)] * 3, number(-100, 100), number(0, 1)
)


@settings(max_examples=50)
@given(
    st.lists(st.tuples(OBJECT, st.integers(0, 8), number(-160, 160)), max_size=4),
    st.tuples(number(-1e7, 1e7), number(-1e7, 1e7), number(-1000, 8000)),
    st.integers(0, 2**42 * 10**6 - 10**7),
    st.integers(0, 2**32 - 1),
)
def test_all_that_is_in_range_comes_back_within_the_stated_errors(
    rows: list[Any], position: tuple[float, ...], captured_ns: int, station: int
) -> None:
    table = np.array([row for row, _, _ in rows]).reshape(-1, 8)
    label = np.array([each for _, each, _ in rows], dtype=np.int64)
    velocity = np.array([[speed, -speed] for _, _, speed in rows]).reshape(-1, 2)
    objects = Detections(Boxes3D.from_array(table[:, :7]), table[:, 7], label, velocity=velocity)
    sent = CollectivePerception(station, captured_ns, np.array(position), objects)
    got = CODEC.decode(CODEC.encode(sent))
    assert got.station_id == station and abs(got.captured_ns - captured_ns) <= 500_000
    assert np.abs(got.position - sent.position).max() <= 0.006
    found = got.objects
    assert np.abs(found.boxes.center - objects.boxes.center).max(initial=0) <= 0.005 + 1e-9
    assert np.abs(found.boxes.size - objects.boxes.size).max(initial=0) <= 0.05 + 1e-9
    assert np.abs(wrap_angle(found.boxes.yaw - objects.boxes.yaw)).max(initial=0) <= np.radians(0.05) + 1e-9
    bound = np.where(objects.score < 0.005, 0.01, 0.005 + 1e-12)
    assert (np.abs(found.score - objects.score) <= bound).all()
    np.testing.assert_array_equal(found.label, np.where(label == CHILD, PEDESTRIAN, label))
    if len(rows):
        assert found.velocity is not None
        assert np.abs(found.velocity - velocity).max() <= 0.005 + 1e-9


def test_the_bits_are_those_that_unaligned_per_gives() -> None:
    """One car, worked out by hand: X.691 writes an integer in a range as its distance from where the range begins."""
    car = Detections(Boxes3D.from_array([[12.34, -5.0, 0.8, 4.5, 1.9, 1.6, np.pi / 2]]), [0.87], [0])
    sent = CollectivePerception(4711, 1_500_000_000, np.array([111.31949, -222.63898, 1.5]), car)
    absent, present, unavailable = (0, 1), (1, 1), (4095, 12)
    container = bits(
        absent,  # no extension of the container
        (1, 8),  # number of perceived objects
        absent,  # of the list's size
        (1, 8),  # size
        absent,  # of the object
        *[present, absent, absent, present, absent, absent],  # id, velocity, acceleration, angles, turn, matrices
        *[
            present,
            present,
            present,
            absent,
            absent,
            absent,
            present,
            absent,
        ],  # sizes, age, quality, sensors, class, map
        (0, 16),
        (2048, 12),  # measured at the reference time
        present,  # z
        *[(1234 + 131_072, 18), unavailable, (-500 + 131_072, 18), unavailable, (80 + 131_072, 18), unavailable],
        *[absent, absent, (900, 12), (126, 7)],  # no other angles; 90.0 degrees, accuracy unavailable
        *[(16 - 1, 8), (31, 5), (19 - 1, 8), (31, 5), (45 - 1, 8), (31, 5)],
        (1 - 1, 3),  # one class
        *[absent, (0, 2), (5, 4), (87 - 1, 7)],  # no extension, a vehicle, a passenger car, 87 %
    )
    message = bits(
        *[(2, 8), (14, 8), (4711, 32)],
        *[absent, absent, absent, absent],  # extensions of payload and management, segments, rates
        (1500, 42),
        *[(900_000_000 - 20_000, 31), (1_800_000_000 + 10_000, 32)],
        *[(4095, 12), (4095, 12), (3601, 12), (100_000 + 150, 20), (15, 4)],
        *[absent, (1 - 1, 3), (5 - 1, 4), (len(container), 8)],  # one container, of perceived objects
        *[(byte, 8) for byte in container],
    )
    assert CODEC.encode(sent) == message


FOREIGN = bytes.fromhex(
    "020e00001267000000001771ad24d7035a4fc887ffffff088c39b7822f00c06d388000200302697ffbfc19fff00287ffd115"
    "bf3f21fc1c27e0ff897cb3e02d649c400030017e0c3ffe0c1cfff8016bffce0ffc23f06f82fc1053b4e20002800ecec1ffe4"
    "c507ffbfffffff017ffdf9fff09a5f843e0bf11f82540000"
)
"""A message by another implementation: pycrate 0.8.1, from ETSI's own modules (see `docs/reference/codecs.md`)."""


def test_a_message_of_another_implementation_is_read_and_written_alike() -> None:
    """A car with a velocity, a pedestrian, and an e-scooter far away and fast."""
    got = CODEC.decode(FOREIGN)
    assert (got.station_id, got.captured_ns) == (4711, 1_500_000_000)
    np.testing.assert_allclose(got.position, [111.31949, -222.63898, 1.5])
    assert got.objects.label.tolist() == [ObjectClass.CAR, PEDESTRIAN, ObjectClass.SCOOTER]
    np.testing.assert_allclose(got.objects.score, [0.87, 0.40, 0.01])
    center = [[12.335, -5.005, 0.795], [-20.005, 30.995, 0.895], [919.995, -920.005, -0.015]]
    np.testing.assert_allclose(got.objects.boxes.center, center)
    np.testing.assert_allclose(got.objects.boxes.size, [[4.45, 1.85, 1.55], [0.55, 0.65, 1.75], [1.75, 0.55, 1.65]])
    np.testing.assert_allclose(np.degrees(got.objects.boxes.yaw), [89.95, -0.15, 123.35])
    assert got.objects.velocity is not None
    np.testing.assert_allclose(got.objects.velocity, [[11.105, -2.225], [np.nan, np.nan], [-160.005, 159.995]])
    assert CODEC.encode(got) == FOREIGN


def observed(found: Detections, pose: PoseEstimate) -> Observation:
    return Observation(3_000_000_000, pose, Odometry(np.zeros(4)), found)


def test_what_is_shared_comes_back_in_the_senders_frame() -> None:
    found = some_detections(40)
    pose = PoseEstimate(np.array([120.0, -40.0, 0.5, 2.1]))
    message = ShareDetections("cpm").message("cav_3", observed(found, pose))
    assert message is not None
    got = decode_detections(message)
    # An error along each of the world's axes is one along the sender's, at most the diagonal.
    assert np.abs(got.boxes.center - found.boxes.center).max() <= 0.005 * np.sqrt(2)
    assert np.abs(wrap_angle(got.boxes.yaw - found.boxes.yaw)).max() <= np.radians(0.05) + 1e-9
    content = CODEC.decode(message.payload)
    np.testing.assert_allclose(content.position, pose.xyz_yaw[:3], atol=0.006)
    there = found.boxes.transform(pose.world_SE3_base).center - pose.xyz_yaw[:3]
    np.testing.assert_allclose(content.objects.boxes.center, there, atol=0.005)


def without_velocities(content: CollectivePerception) -> CollectivePerception:
    return replace(content, objects=replace(content.objects, velocity=None))


def test_a_velocity_that_the_standard_cannot_express_is_unknown() -> None:
    content = some_perception(3)
    velocity = np.array([[163.7, 0.0], [0.0, -163.9], [np.nan, 1.0]])
    got = CODEC.decode(CODEC.encode(replace(content, objects=replace(content.objects, velocity=velocity))))
    assert got.objects.velocity is not None
    np.testing.assert_array_equal(np.isfinite(got.objects.velocity).all(axis=1), [True, False, False])


def test_velocities_turn_with_the_axes() -> None:
    """Sent east and north, and read in the sender's own axes, whose x is north here."""
    pose = PoseEstimate(np.array([5.0, 6.0, 0.0, np.pi / 2]))
    found = replace(some_detections(1), velocity=np.array([[10.0, 1.0]]))
    content = CODEC.content_of(found, "cav_0", 0, pose)
    np.testing.assert_allclose(content.objects.velocity, [[-1.0, 10.0]], atol=1e-9)
    back = CODEC.detections_in(CODEC.decode(CODEC.encode(content)), pose)
    np.testing.assert_allclose(back.velocity, found.velocity, atol=0.008)


def test_an_object_takes_at_most_40_bytes() -> None:
    sizes = [len(CODEC.encode(some_perception(count))) for count in (1, 255)]
    still = [len(CODEC.encode(without_velocities(some_perception(count)))) for count in (1, 255)]
    assert (sizes[1] - sizes[0]) / 254 < 40 and (still[1] - still[0]) / 254 < 28


def test_of_too_many_objects_the_surest_are_shared() -> None:
    message = ShareDetections("cpm").message("cav_0", observed(some_detections(400), PoseEstimate(np.zeros(4))))
    assert message is not None
    assert decode_detections(message).score.min() >= np.sort(some_detections(400).score)[-255] - 0.005


def test_what_is_out_of_range_is_left_out() -> None:
    rows = np.tile([10.0, 0, 0.8, 4.5, 1.9, 1.6, 0.0], (8, 1))
    rows[1, 0], rows[2, 1], rows[3, 2], rows[4, 3], rows[5, 6], rows[6, 4] = 1311, np.nan, -1311, 25.5, np.inf, 0.0
    found = Detections(Boxes3D.from_array(rows), [0.5] * 7 + [1.1], [0] * 8)
    assert CODEC.sendable(found).tolist() == [True] + [False] * 7
    message = ShareDetections("cpm").message("cav_0", observed(found, PoseEstimate(np.zeros(4))))
    assert message is not None and len(decode_detections(message)) == 1


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"station_id": -1}, "station -1 .* out of ETSI's range"),
        ({"captured_ns": -1}, "at -1 ns is out of ETSI's range"),
        ({"position": [0, 2e7, 0]}, "a station must be on earth"),
        ({"position": [0, 0, np.nan]}, "a station must be on earth"),
        ({"objects": some_detections(256)}, "at most 255 objects, got 256"),
    ],
)
def test_what_cannot_be_sent_is_refused(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(CodecError, match=match):
        CODEC.encode(replace(some_perception(5), **changes))


def raw(objects: list[dict[str, Any]], **changes: Any) -> bytes:
    """A message of others, with these objects."""
    message = messages().decode("CollectivePerceptionMessage", CODEC.encode(some_perception(0)))
    data = messages().encode(
        "PerceivedObjectContainer", {"numberOfPerceivedObjects": len(objects), "perceivedObjects": objects}
    )
    foreign = {"containerId": 1, "containerData": b"what a vehicle says of itself"}
    message["payload"]["cpmContainers"] = [foreign, {"containerId": 5, "containerData": data}]
    message["header"] |= changes
    return bytes(messages().encode("CollectivePerceptionMessage", message))


def whole_object() -> dict[str, Any]:
    outer = messages().decode("CollectivePerceptionMessage", CODEC.encode(without_velocities(some_perception(1))))
    data = outer["payload"]["cpmContainers"][0]["containerData"]
    found: dict[str, Any] = messages().decode("PerceivedObjectContainer", data)["perceivedObjects"][0]
    return found


@pytest.mark.parametrize(("label", "number"), [("CAR", 5), ("BUS", 6), ("VAN", 7), ("TRUCK", 8)])
def test_vehicles_have_the_standards_numbers(label: str, number: int) -> None:
    """TrafficParticipantType of TS 102 894-2: passengerCar, bus, lightTruck, heavyTruck."""
    classified = whole_object() | {"classification": [{"objectClass": ("vehicleSubClass", number), "confidence": 90}]}
    assert CODEC.decode(raw([classified])).objects.label.tolist() == [int(ObjectClass[label])]


def test_other_containers_and_objects_that_are_no_boxes_are_passed_over() -> None:
    good = whole_object()
    unknown = {"objectClass": ("otherSubClass", 1), "confidence": 90}
    tram = {"objectClass": ("vehicleSubClass", 11), "confidence": 90}
    less = [{name: value for name, value in good.items() if name != gone} for gone in ("angles", "objectDimensionX")]
    others = [*less, *(good | {"classification": [each]} for each in (unknown, tram))]
    others += [good | {"angles": {"zAngle": {"value": 3601, "confidence": 127}}}]
    assert len(CODEC.decode(raw([good, *others, good])).objects) == 2


def test_parts_that_are_not_read_and_other_messages_are_refused() -> None:
    with pytest.raises(CodecError, match="the objects have acceleration, which coopsim does not read"):
        CODEC.decode(raw([whole_object() | {"acceleration": None}]))
    with pytest.raises(CodecError, match="protocol 2 and id 14"):
        CODEC.decode(raw([], messageId=2))
    with pytest.raises(CodecError, match="at most 32768 bytes, got 40000"):
        CODEC.decode(bytes(40_000))


def test_without_asn1tools_what_to_install_is_said_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for cached in (messages, decoder):
        cached.cache_clear()
    monkeypatch.setitem(sys.modules, "asn1tools", None)
    try:
        for attempt in (lambda: named_uplink("detections", "cpm"), CpmCodec):
            with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[etsi\]'"):
                attempt()
    finally:
        for cached in (messages, decoder):
            cached.cache_clear()


def test_a_message_of_another_codec_is_none() -> None:
    other = Message("cav_0", 0, PoseEstimate(np.zeros(4)), CODEC.encode(some_perception(2)), "detections")
    with pytest.raises(CodecError):
        decode_detections(other)
