"""What a fusion of maps sends, and what it tells its network of the places of senders."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
from street_scene import observe, spec_of
from tiny_networks import learned

import coopsim
from coopsim.agents.perceiving_policy import Received
from coopsim.comms.envelope import decode_features
from coopsim.geometry.se3 import SE3
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate


def alignment_that_knows(left: Any) -> Any:
    return SimpleNamespace(covariance=lambda sender: left)


@pytest.mark.parametrize(
    ("alignment", "error"),
    [
        (None, (0.5, 0.05)),
        (alignment_that_knows(np.diag([0.01, 0.01, 0.0001])), (0.1, 0.01)),
        (alignment_that_knows(None), (0.5, 0.05)),
    ],
    ids=["stated", "left by common objects", "not heard for long"],
)
def test_a_network_is_told_what_is_left_of_the_errors(alignment: Any, error: tuple[float, float]) -> None:
    policy = coopsim.make_policy("attfuse", **learned("attfuse"))
    policy.reset({name: spec_of(name, "cav") for name in ("cav_0", "cav_1")}, seed=0)
    policy._states["cav_0"].alignment = alignment
    own, other = (np.diag(np.square([size, size, size / 10])) for size in (0.3, 0.4))
    observation = Observation(0, PoseEstimate(np.zeros(4), own), Odometry(np.zeros(4)), Detections.empty())
    message = Message("cav_1", 0, PoseEstimate(np.zeros(4), other), b"", "features")
    received = Received(message, None, 0, SE3.from_xyz_yaw(np.zeros(3), 0.0))
    assert policy._error("cav_0", observation, received) == pytest.approx(error)


@pytest.mark.parametrize("name", ["attfuse", "gsaf", "v2x_vit", "where2comm"])
def test_messages_of_all_channels_have_the_most_confident_cells_alone(name: str) -> None:
    policy = coopsim.make_policy(name, weights=f"{name}64")
    spec, rng = spec_of("rsu_0", "rsu"), np.random.default_rng(0)
    policy.reset({spec.name: spec}, seed=0)
    uplink = policy.make_uplink(spec, rng)
    uplink.begin(spec, rng)
    message = uplink.message("rsu_0", observe(0))
    features = decode_features(message)
    sent = np.abs(features.values).max(axis=0) > 0
    assert len(features.values) == 64 and sent.sum() <= 600 and 30_000 < len(message.payload) < 42_000
    assert features.confidence is not None
