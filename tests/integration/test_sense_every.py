"""Sensors that run in every n-th frame: nothing else changes, and policies are told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import InvalidValueError
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.types import Observation, Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.wire.observation_format import ObservationFormat

Make = Callable[..., Any]

NOISY: dict[str, Any] = {
    "position_noise_m": 0.3,
    "heading_noise_rad": 0.01,
    "latency_s": 0.1,
    "loss": 0.2,
    "expose_ground_truth": True,
    "ground_truth": "all",
    "max_cycles": 7,
}
CAMERAS: dict[str, Any] = {"cameras": [Camera("front", Intrinsics.from_fov(32, 18))], "renderer": "raycast"}


def play(env: Any) -> list[Any]:
    observations, infos = env.reset(seed=4)
    frames = [(observations, infos)]
    while env.agents:
        idle = {agent: {"tracks": pack_tracks(Tracks.empty())} for agent in env.agents}
        observations, _, _, _, infos = env.step(idle)
        frames.append((observations, infos))
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)
    assert len(frames) > 1 and all(infos for _, infos in frames)
    return frames


@pytest.mark.parametrize("detector", ["simulated", "pointpillars_v2v4real"])
def test_truth_and_poses_are_those_of_a_run_that_senses_always(make_small: Make, detector: str) -> None:
    always, third = (play(make_small(detector=detector, sense_every=n, **NOISY, **CAMERAS)) for n in (1, 3))
    received = 0
    for k, ((all_seen, all_infos), (seen, infos)) in enumerate(zip(always, third, strict=True)):
        for agent, observation in seen.items():
            for key in ("time_ns", "pose", "odometry"):
                np.testing.assert_array_equal(observation[key], all_seen[agent][key])
            captured = observation["inbox"]["captured_ns"]
            assert (captured % 300_000_000 == 0).all()  # nothing is sent in the other frames
            received += len(captured)
            truth, all_truth = infos[agent]["ground_truth"], all_infos[agent]["ground_truth"]
            for key in ("id", "box", "velocity", "label", "in_region", "counts"):
                np.testing.assert_array_equal(truth[key], all_truth[key])
            np.testing.assert_array_equal(infos[agent]["true_pose"], all_infos[agent]["true_pose"])
            sensed = k % 3 == 0
            assert observation["sensed"] == sensed and "sensed" not in all_seen[agent]
            assert (len(observation["sweeps"]["lidar"]) > 0) == sensed
            assert observation["cameras"]["front"]["rgb"].any() == sensed
            if sensed:
                np.testing.assert_array_equal(
                    observation["cameras"]["front"]["depth"], all_seen[agent]["cameras"]["front"]["depth"]
                )
            else:
                assert not len(observation["detections"]["score"])
    assert any(len(observation["detections"]["score"]) for observation in third[3][0].values())
    assert received
    first, again = (frames[0][0]["cav_0"] for frames in (always, third))
    np.testing.assert_array_equal(first["sweeps"]["lidar"], again["sweeps"]["lidar"])
    np.testing.assert_array_equal(first["detections"]["box"], again["detections"]["box"])


def test_what_was_visible_when_last_sensed_counts_until_the_next_time(make_small: Make) -> None:
    options = NOISY | {"ground_truth": "visible"}
    frames = play(make_small(detector="simulated", sense_every=3, **options))
    for k, (_, infos) in enumerate(frames):
        last = frames[k - k % 3][1]
        for agent, info in infos.items():
            visible = {
                int(identity)
                for identity, count in zip(
                    last[agent]["ground_truth"]["id"], last[agent]["ground_truth"]["returns"].sum(axis=1), strict=True
                )
                if count
            }
            truth = info["ground_truth"]
            assert set(truth["id"][truth["counts"]].tolist()) == visible & set(truth["id"][truth["in_region"]].tolist())


def test_a_policy_is_told_and_gets_no_blank_images(make_small: Make) -> None:
    env = make_small(detector="simulated", sense_every=2, lidar=None, **NOISY, **CAMERAS)
    unpack = ObservationFormat.to_unpack(env.agent_specs).unpack
    for k, (observations, _) in enumerate(play(env)):
        observation: Observation = unpack(observations["cav_0"])
        assert observation.sensed == (k % 2 == 0) and bool(observation.cameras) == observation.sensed
    assert {spec.sense_every for spec in env.agent_specs.values()} == {2}
    assert coopsim.evaluate("late_fusion", "crossing", seed=1, sense_every=2, max_cycles=6).score["GT"] > 0


def test_bad_numbers_of_frames(make_small: Make) -> None:
    for wrong in (0, 1.5, True):
        with pytest.raises(InvalidValueError, match="sense_every must be an integer >= 1"):
            make_small(sense_every=wrong)
