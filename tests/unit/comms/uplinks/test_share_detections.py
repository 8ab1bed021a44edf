"""Boxes are sent with velocities, if they are asked for."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

import coopsim
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.errors import CoopsimError
from coopsim.geometry.se3 import SE3
from coopsim.types import AgentSpec, Observation, Odometry, PoseEstimate


def test_velocities_are_over_ground_in_the_axes_of_the_sender() -> None:
    """The sender drives east at 10 m/s and turns left; a car ahead drives east at 20 m/s."""
    uplink = ShareDetections("compact", velocities=True)
    spec = AgentSpec("cav_0", "cav", 0.1, uplink="detections")
    uplink.begin(spec, np.random.default_rng(0))
    for k in range(6):
        turn = np.array([1.0, 0.0, 0.0, 0.1]) if k else np.zeros(4)
        world_SE3_base = SE3.identity()
        for _ in range(k):
            world_SE3_base = world_SE3_base.compose(SE3.from_xyz_yaw(np.array([1.0, 0, 0]), 0.1))
        seen = cars(30.0 + 2.0 * k, 50.0).transform(world_SE3_base.inverse())
        message = uplink.message("cav_0", Observation(k * FRAME_NS, PoseEstimate(np.zeros(4)), Odometry(turn), seen))
        assert message is not None
        got = decode_detections(message).velocity
        if k == 0:
            assert got is None
    assert got is not None
    world = got @ world_SE3_base.rotation[:2, :2].T
    np.testing.assert_allclose(world, [[20.0, 0.0], [0.0, 0.0]], atol=0.7)


@pytest.mark.parametrize("codec", ["detections", "compact", "cpm"])
def test_a_policy_asks_for_velocities(codec: str) -> None:
    pytest.importorskip("asn1tools") if codec == "cpm" else None
    options = {"lidar": None, "max_cycles": 12, "latency_s": 0.3, "codec": codec, "seed": 4}
    plain, moving = (
        coopsim.evaluate(f"late_fusion(velocities={each})", "crossing", **options) for each in (False, True)
    )
    assert moving.score["bytes_per_s"] > plain.score["bytes_per_s"]
    assert moving.score["sAMOTA"] > 0


def test_a_policy_that_shares_no_boxes_refuses_velocities() -> None:
    with pytest.raises(CoopsimError, match="velocities must be False for a policy that shares no boxes"):
        coopsim.make_policy("no_fusion(velocities=True)")
