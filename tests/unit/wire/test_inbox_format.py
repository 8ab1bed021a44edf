"""Receivers of a frame share what they hear, and nothing that they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate
from coopsim.wire.observation_format import ObservationFormat

AGENTS = ("cav_0", "cav_1", "rsu_0")


def said(sender: str, payload: bytes, captured_ns: int = 5, spread: float | None = None) -> Message:
    covariance = None if spread is None else spread * np.eye(3)
    return Message(sender, captured_ns, PoseEstimate(np.arange(4.0), covariance), payload, "detections")


def observed(*inbox: Message) -> Observation:
    here = np.zeros(4)
    return Observation(5, PoseEstimate(here), Odometry(here), Detections.empty(), inbox=inbox)


def heard_by_two(*, covariances: bool = False) -> tuple[ObservationFormat, dict[str, Any]]:
    wire = ObservationFormat(AGENTS, pose_covariances=covariances)
    common, spread = said("rsu_0", b"common", spread=2.0 if covariances else None), said("cav_1", b"one")
    return wire, wire.pack_all({"cav_0": observed(common, spread), "cav_1": observed(common)})


def contents(message: Message) -> tuple[Any, ...]:
    spread = message.pose.covariance
    stated = None if spread is None else spread.tolist()
    return message.sender, message.captured_ns, message.pose.xyz_yaw.tolist(), stated, message.payload, message.codec


@pytest.mark.parametrize("covariances", [False, True])
def test_all_together_are_packed_and_read_as_each_by_itself(covariances: bool) -> None:
    wire, packed = heard_by_two(covariances=covariances)
    unpacked = wire.unpack_all(packed)
    assert any(observation.inbox for observation in unpacked.values())
    for name, observation in unpacked.items():
        alone = wire.unpack(packed[name])
        again = wire.pack(alone)
        assert [*map(contents, observation.inbox)] == [*map(contents, alone.inbox)]
        for column, values in packed[name]["inbox"].items():
            np.testing.assert_array_equal(again["inbox"][column], values)
        np.testing.assert_array_equal(again["inbox_payload"], packed[name]["inbox_payload"])


def test_receivers_of_a_broadcast_share_its_message() -> None:
    wire, packed = heard_by_two()
    seen = wire.unpack_all(packed)
    assert seen["cav_0"].inbox[0] is seen["cav_1"].inbox[0]


@pytest.mark.parametrize("column", ["captured_ns", "codec", "sender", "pose", "pose_covariance", "inbox_payload"])
def test_a_receiver_of_other_bytes_gets_its_own(column: str) -> None:
    wire, packed = heard_by_two(covariances=True)
    honest = [*map(contents, wire.unpack_all(packed)["cav_0"].inbox)]
    forged = packed["cav_1"] if column == "inbox_payload" else packed["cav_1"]["inbox"]
    forged[column] = forged[column] + np.ones((), forged[column].dtype)
    if column == "sender":
        forged[column] = np.array([0])
    seen = wire.unpack_all(packed)
    assert [*map(contents, seen["cav_0"].inbox)] == honest
    assert contents(seen["cav_1"].inbox[0]) == contents(wire.unpack(packed["cav_1"]).inbox[0]) != honest[0]


def test_what_a_caller_writes_later_reaches_no_message() -> None:
    wire, packed = heard_by_two()
    seen = wire.unpack_all(packed)
    packed["cav_0"]["inbox"]["pose"][:] = 9.0
    assert seen["cav_1"].inbox[0].pose.xyz_yaw.tolist() == [0, 1, 2, 3]


def test_poses_of_another_shape_are_refused() -> None:
    wire, packed = heard_by_two()
    packed["cav_0"]["inbox"]["pose"] = np.zeros((2, 3))
    with pytest.raises(InvalidValueError, match=r"inbox pose must have shape \(2, 4\)"):
        wire.unpack_all(packed)


def test_copies_of_a_message_have_one_identity_and_others_have_their_own() -> None:
    one = said("cav_0", b"boxes", spread=1.0)
    assert one.identity == said("cav_0", bytes(bytearray(b"boxes")), spread=1.0).identity
    others = [said("cav_1", b"boxes", spread=1.0), said("cav_0", b"boxes"), said("cav_0", b"boxes", 6, spread=1.0)]
    assert all(one.identity != other.identity for other in others)
