"""Agents with and without LiDARs in one scene, and cameras by kind of agent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.detection.detector import Detector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.errors import CoopsimError, InvalidValueError, PolicyMismatchError, ScenarioFileError, UnknownNameError
from coopsim.types import Detections

SMALL: dict[str, Any] = {
    "vehicles": 8,
    "connected_cars": 2,
    "drones": 1,
    "max_cycles": 3,
    "lidar": "VLP-16",
    "lidar_columns": 128,
}


def make(**options: Any) -> Any:
    return coopsim.parallel_env("crossing", **(SMALL | options))


def frames(env: Any) -> list[Any]:
    """Observations and infos of an episode, checked against the spaces."""
    policy = coopsim.make_policy("late_fusion")
    observations, infos = env.reset(seed=5)
    policy.reset(env.agent_specs)
    played = [(observations, infos)]
    while True:
        observations, _, _, _, infos = env.step(policy.act(observations))
        if not env.agents:
            assert len(played) > 1 and all(seen for seen, _ in played)
            return played
        for agent in env.agents:
            assert env.observation_space(agent).contains(observations[agent])
        played.append((observations, infos))


@pytest.mark.parametrize(
    ("given", "carriers"),
    [
        (None, {"cav_0", "cav_1", "rsu_0", "drone_0"}),
        (["cav"], {"cav_0", "cav_1"}),
        ("rsu", {"rsu_0"}),
        (("cav_1", "drone"), {"cav_1", "drone_0"}),
    ],
)
def test_those_that_are_named_carry_lidars_and_no_others(given: Any, carriers: set[str]) -> None:
    env = make(lidar_agents=given, expose_ground_truth=True, expose_visibility=True)
    for observations, infos in frames(env):
        for agent, observation in observations.items():
            here = agent in carriers
            assert list(observation["sweeps"]) == list(env.agent_specs[agent].lidars) == ["lidar"] * here
            assert list(infos[agent]["instances"]) == ["lidar"] * here
            assert ("visibility" in infos[agent]) == here
            if here:
                assert len(observation["sweeps"]["lidar"])


def test_the_sweeps_of_one_agent_do_not_depend_on_who_else_has_a_lidar() -> None:
    everyone, some = (frames(make(lidar_agents=given)) for given in (None, ["cav_1"]))
    for (whole, _), (part, _) in zip(everyone, some, strict=True):
        np.testing.assert_array_equal(whole["cav_1"]["sweeps"]["lidar"], part["cav_1"]["sweeps"]["lidar"])


def test_agents_without_lidar_are_as_with_lidar_none() -> None:
    """The truth and simulated detectors take the returns that are to be expected."""
    options = {"expose_ground_truth": True, "detector": SimulatedDetector(), "lidar_columns": 1024, "lidar": "HDL-32E"}
    without = make(**options | {"lidar": None}).reset(seed=5)
    everyone = make(**options).reset(seed=5)
    some = make(**options, lidar_agents=["cav_0"]).reset(seed=5)
    names = list(some[0])
    for agent in names:
        returns = [infos[agent]["ground_truth"]["returns"] for _, infos in (some, everyone, without)]
        np.testing.assert_array_equal(returns[0][:, 0], returns[1][:, 0])
        np.testing.assert_array_equal(returns[0][:, 1:], returns[2][:, 1:])
        assert returns[0][:, 1:].any()
        same_as = everyone if agent == "cav_0" else without
        np.testing.assert_array_equal(
            some[0][agent]["detections"]["box"], same_as[0][agent]["detections"]["box"], err_msg=agent
        )


def test_frames_in_which_nothing_is_sensed() -> None:
    played = frames(make(lidar_agents=["rsu"], sense_every=2, max_cycles=4))
    assert [len(observations["rsu_0"]["sweeps"]["lidar"]) > 0 for observations, _ in played] == [True, False] * 2
    assert all(observations["cav_0"]["sweeps"] == {} for observations, _ in played)


def test_a_detector_and_an_uplink_of_points_bear_agents_without() -> None:
    class Counting(Detector):
        def detect(self, view: Any, rng: Any) -> Detections:
            assert set(view.sweeps) == set(view.lidars)
            return Detections.empty()

    make(lidar_agents=["cav"], detector=Counting(), uplink="points").reset(seed=1)


class Points(coopsim.Policy):
    """Reads points."""

    needs = coopsim.Needs(uplink="none", lidar=True)

    def track(self, agent: str, observation: Any) -> Any:
        return coopsim.types.Tracks.empty()


def test_a_policy_that_reads_points_wants_them_of_all() -> None:
    with pytest.raises(PolicyMismatchError, match=r"Points needs a LiDAR, but rsu_0 has none: .* lidar_agents=None"):
        coopsim.evaluate(Points(), **SMALL, lidar_agents=["cav"])


def test_cameras_by_kind_and_by_name() -> None:
    env = make(cameras={"rsu": "surround", "cav": "front", "cav_1": False}, renderer="raycast")
    rigs = {name: list(spec.cameras) for name, spec in env.agent_specs.items()}
    around = ["front", "left", "rear", "right"]
    assert rigs == {"cav_0": ["front"], "cav_1": [], "rsu_0": around, "drone_0": []}


def test_in_scenario_files_vectors_and_benchmarks(tmp_path: Path) -> None:
    from coopsim.bench.detect.detect import measure_detection
    from coopsim.bench.detect.detect_plan import DetectPlan

    path = tmp_path / "mine.yaml"
    text = "scenario: crossing\npopulation: {vehicles: 6}\noptions:\n  lidar: VLP-16\n  lidar_agents: [cav]\n"
    path.write_text(text + "  lidar_columns: 128\n")
    env = coopsim.parallel_env(path)
    assert {name for name, spec in env.agent_specs.items() if spec.lidars} == {"cav_0", "cav_1", "cav_2"}
    path.write_text(text + "  cameras: {rsv: front}\n")
    with pytest.raises(ScenarioFileError, match=r"mine.yaml:\d+: unknown cameras of agent 'rsv'. Did you mean 'rsu'"):
        coopsim.parallel_env(path)
    with coopsim.vector("crossing", 2, workers=0, **SMALL, lidar_agents=["rsu"]) as vector:
        vector.reset(seed=1)
    options = SMALL | {"lidar_agents": ["cav"]}
    del options["max_cycles"]
    plan = DetectPlan(policies=("no_fusion",), seeds=(0,), frames=2, detector="simulated", options=options)
    (row,) = measure_detection(plan)
    assert row["options"]["lidar_agents"] == ["cav"] and row["objects"] > 0


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        ({"lidar_agents": ["cav_7"]}, UnknownNameError, "unknown agent in lidar_agents 'cav_7'. Did you mean 'cav"),
        ({"lidar_agents": []}, InvalidValueError, r"lidar_agents must be names of agents, or of cav, rsu, drone.*\[\]"),
        ({"lidar_agents": 3}, InvalidValueError, "lidar_agents must be names .* got 3"),
        ({"lidar_agents": [3]}, InvalidValueError, r"lidar_agents must be names .* got \[3\]"),
        ({"lidar_agents": ["rsu"], "rsus": 0}, InvalidValueError, "lidar_agents must name some of the agents .*cav_0"),
        ({"lidar_agents": ["cav"], "lidar": None}, InvalidValueError, "must be left out where lidar is None"),
        ({"cameras": {"car": "front"}}, UnknownNameError, "unknown cameras of agent 'car'. Did you mean 'cav'"),
    ],
)
def test_wrong_names_are_refused(given: dict[str, Any], error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        make(**given)
