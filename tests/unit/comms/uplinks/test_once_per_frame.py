"""Encoders and trackers run once per agent and frame, and never take one episode for another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from coopsim.comms.uplinks.once_per_frame import EncodeOnce, StepOnce, same
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, Observation, Odometry, PoseEstimate, SensorView, Sweep


def view(agent: str = "cav_0", time_ns: int = 0, x: float = 1.0) -> SensorView:
    sweep = Sweep(np.array([[x, 0, 0], [np.nan, 1, 0]]), np.zeros(2), np.zeros(2, dtype=int))
    return SensorView(agent, time_ns, Odometry(np.zeros(4)), {"top": sweep})


def observe(time_ns: int, x: float = 1.0) -> Observation:
    box = Boxes3D.from_array([[x, 0, 0, 4, 2, 1.5, 0], [np.nan, 0, 0, 4, 2, 1.5, 0]])
    found = Detections(box, np.ones(2), np.zeros(2, dtype=int))
    return Observation(time_ns, PoseEstimate(np.zeros(4)), Odometry(np.zeros(4)), found)


def test_equal_views_are_encoded_once_and_in_one_batch() -> None:
    batches: list[list[str]] = []

    def encode_all(views: Mapping[str, SensorView]) -> dict[str, float]:
        batches.append(sorted(views))
        return {agent: float(each.sweeps["top"].points[0, 0]) for agent, each in views.items()}

    encode = EncodeOnce(lambda each: -1.0, encode_all)
    views = [view("cav_0", x=3.0), view("cav_1", x=4.0)]
    assert encode.all(views) == {"cav_0": 3.0, "cav_1": 4.0}
    assert encode(view("cav_0", x=3.0)) == 3.0  # an equal one, as the policy gets it
    assert encode.all([view("cav_0", x=3.0), view("rsu_0", x=5.0)]) == {"cav_0": 3.0, "rsu_0": 5.0}
    assert batches == [["cav_0", "cav_1"], ["rsu_0"]]


def test_another_frame_or_another_episode_is_encoded_anew() -> None:
    encode = EncodeOnce(lambda each: float(each.sweeps["top"].points[0, 0]))
    assert [encode(each) for each in (view(x=1), view(x=2), view(time_ns=5, x=2), view(x=1))] == [1, 2, 2, 1]


def test_another_pose_is_encoded_anew() -> None:
    encode = EncodeOnce(lambda each: None if each.pose is None else float(each.pose.xyz_yaw[3]))
    poses = [PoseEstimate(np.array([0, 0, 0, yaw])) for yaw in (0.1, 0.2)]
    assert [encode(replace(view(), pose=pose)) for pose in (None, *poses)] == [None, 0.1, 0.2]


class Counter:
    """Adds up where the first box was."""

    def __init__(self) -> None:
        self.total = 0.0

    def step(self, observation: Observation) -> float:
        self.total += float(observation.detections.boxes.center[0, 0])
        return self.total


def test_a_step_is_taken_once_per_frame_whoever_asks_first() -> None:
    steps = StepOnce(Counter, Counter.step)
    steps.begin_sending("cav_0")
    assert steps("cav_0", observe(0)) == 1  # the uplink, in env.reset
    steps.begin("cav_0")  # policy.reset
    assert steps("cav_0", replace(observe(0), inbox=())) == 1  # its track
    assert [steps("cav_0", observe(time_ns)) for time_ns in (1, 1, 2, 2)] == [2, 2, 3, 3]
    assert steps("cav_1", observe(2)) == 1
    assert steps.state("cav_0").total == 3


def test_a_new_episode_forgets_the_last_one() -> None:
    steps = StepOnce(Counter, Counter.step)
    for time_ns in range(5):
        steps("cav_0", observe(time_ns))
    assert steps("cav_0", observe(0)) == 1  # time went back
    steps.begin_sending("cav_0")
    assert steps("cav_0", observe(0)) == 1
    steps.begin("cav_0")
    steps.begin("cav_0")  # another episode, whose uplink is not this one's
    assert steps("cav_0", observe(7)) == 1


def test_a_first_frame_of_another_environment_is_not_taken_for_this_ones() -> None:
    steps = StepOnce(Counter, Counter.step)
    steps.begin_sending("cav_0")
    assert steps("cav_0", observe(0, x=100.0)) == 100  # an environment that is then left alone
    steps.begin("cav_0")
    assert steps("cav_0", observe(0)) == 1
    assert steps("cav_0", observe(1)) == 2


def test_a_frame_that_was_changed_on_its_way_is_not_stepped_twice() -> None:
    steps = StepOnce(Counter, Counter.step)
    steps("cav_0", observe(0))
    assert steps("cav_0", observe(1, x=5.0)) == 6
    assert steps("cav_0", observe(1, x=7.0)) == 6


def test_content_is_compared_through_structs_and_nan_equals_nan() -> None:
    assert same(view(), view()) and not same(view(), view(x=2.0))
    assert same({"a": [1]}, {"a": [1]}) and not same({"a": 1}, {"b": 1}) and not same(1, "1")
    assert same({"a": 1}, MappingProxyType({"a": 1})) and not same(1, 1.0)
