"""Infos of driven cars: speed, progress, crash, success, the parts of the reward, and why an episode ended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from tiny_recordings import write_opv2v

import coopsim
from coopsim.envs.wrappers import DrivingRows, Flatten
from coopsim.types import Tracks
from coopsim.types.messages import MANEUVERS
from coopsim.wire.actions import pack_tracks

QUICK: dict[str, Any] = {"lidar": None, "pedestrians": 0, "rsus": 0}
DRIVER: dict[str, Any] = {"control": "acceleration", "tracker": "no_fusion", "reward": "safe_progress", **QUICK}
HIDDEN: dict[str, Any] = {"control": "acceleration", "tracker": "no_fusion", "reward": "safe_progress", "lidar": None}
OWN = {"speed_m_s", "progress", "crashed", "hit_by_log", "red_lights"}

NOTHING = {"tracks": pack_tracks(Tracks.empty())}


def play(env: Any, action: Any, seed: int) -> tuple[list[dict[str, Any]], list[float]]:
    """Return the infos and the rewards of an episode with the same action in all steps."""
    infos, rewards, over = [env.reset(seed=seed)[1]], [], False
    while not over:
        _, reward, terminated, truncated, info = env.step(action)
        infos.append(info)
        rewards.append(reward)
        over = terminated or truncated
    return infos, rewards


def actions(env: Any, command: float) -> dict[str, Any]:
    """Return actions that report nothing, with a command for those that drive."""
    driving = {name: spec.command for name, spec in env.agent_specs.items()}
    return {name: NOTHING | ({driving[name]: command} if driving[name] else {}) for name in env.agents}


@pytest.mark.parametrize(("control", "action"), [("acceleration", [1.0]), ("policy", MANEUVERS.index("faster"))])
def test_a_learner_is_told_of_its_own_car(control: str, action: Any) -> None:
    env = coopsim.single_env("crossing", **DRIVER | {"control": control}, vehicles=2, connected_cars=1, max_cycles=12)
    infos, rewards = play(env, np.float32(action) if control == "acceleration" else action, seed=3)
    assert infos[0].keys() == OWN | {"seed"} and infos[0]["progress"] == 0.0
    for info, reward in zip(infos[1:], rewards, strict=True):
        assert info.keys() - {"end"} == OWN | {"counts", "reward_parts"}
        assert sum(info["reward_parts"].values()) == pytest.approx(reward)
    assert env.parallel.cars["cav_0"].speed_m_s == infos[-1]["speed_m_s"] > infos[0]["speed_m_s"]
    assert infos[-1]["progress"] == pytest.approx(env.parallel.score()["progress"], rel=1e-6)
    assert not infos[-1]["crashed"]


def test_progress_stays_at_the_crash_as_the_metric_does() -> None:
    """With `ends_on_crash=False` the wreck is pushed on, but the metric looks no further."""
    env = coopsim.single_env("occluded_pedestrian", **HIDDEN, ends_on_crash=False)
    infos, _ = next(
        each for each in (play(env, np.float32([1.0]), seed) for seed in range(20)) if each[0][-1]["crashed"]
    )
    assert infos[-1]["progress"] == pytest.approx(env.parallel.score()["progress"], rel=1e-6)
    assert (infos[-1]["end"], infos[-1]["is_success"]) == ("situation over", False)


def test_a_planner_drives_under_the_same_infos_and_others_are_told_nothing() -> None:
    env = coopsim.parallel_env(
        "crossing", control="planner", driven_agents=["cav_1"], max_cycles=2, vehicles=4, **QUICK
    )
    env.reset(seed=1)
    *_, infos = env.step(actions(env, 0.0))
    assert infos["cav_1"].keys() >= OWN and infos["cav_0"].keys() == {"counts"}
    *_, infos = env.step(actions(env, 0.0))
    assert infos["cav_0"].keys() == {"counts", "end"}


def test_a_car_without_a_driver_of_its_own_has_no_such_infos() -> None:
    env = coopsim.parallel_env("highway", control="policy", traffic="highway-env", max_cycles=1, vehicles=3, **QUICK)
    _, infos = env.reset(seed=1)
    assert all(info.keys() == {"seed"} for info in infos.values())


def test_a_situation_ends_in_a_crash_or_with_success() -> None:
    env = coopsim.single_env("occluded_pedestrian", **HIDDEN)
    ends = {}
    for seed in range(20):
        infos, _ = play(env, np.float32([1.0]), seed)
        assert all("end" not in info and "is_success" not in info for info in infos[:-1])
        ends[infos[-1]["end"]] = infos[-1]
        assert infos[-1]["is_success"] is not infos[-1]["crashed"]
        if len(ends) == 2:
            break
    assert {name: info["crashed"] for name, info in ends.items()} == {"crash": True, "situation over": False}
    assert ends["crash"]["reward_parts"]["crash"] == -5.0
    early = coopsim.single_env("occluded_pedestrian", **HIDDEN, max_cycles=3)
    last = play(early, np.float32([-1.0]), 0)[0][-1]
    assert (last["end"], last["is_success"]) == ("max_cycles", True)


def test_elsewhere_no_drive_is_a_success() -> None:
    env = coopsim.single_env("crossing", **DRIVER, vehicles=2, connected_cars=1, max_cycles=2)
    last = play(env, np.float32([0.0]), 0)[0][-1]
    assert last["end"] == "max_cycles" and "is_success" not in last


def test_an_agent_that_does_not_drive_is_told_why_an_episode_ended() -> None:
    env = coopsim.parallel_env("crossing", vehicles=4, max_cycles=1, **QUICK)
    env.reset(seed=1)
    *_, infos = env.step(actions(env, 0.0))
    assert all(info.keys() == {"counts", "end"} and info["end"] == "max_cycles" for info in infos.values())


@pytest.mark.parametrize(("options", "end"), [({}, "recording over"), ({"max_cycles": 1}, "max_cycles")])
def test_a_recording_ends_where_it_is_over_or_is_cut(tmp_path: Path, options: dict[str, int], end: str) -> None:
    env = coopsim.parallel_env("replay", path=write_opv2v(tmp_path), **options)
    env.reset(seed=0)
    while env.agents:
        *_, infos = env.step(actions(env, 0.0))
    assert {info["end"] for info in infos.values()} == {end}


def test_a_reward_without_parts_is_its_only_part() -> None:
    env = coopsim.single_env("crossing", **DRIVER | {"reward": "mota"}, vehicles=2, connected_cars=1, max_cycles=1)
    infos, rewards = play(env, np.float32([0.0]), 0)
    assert infos[1]["reward_parts"] == {"reward": rewards[0]}


def test_gymnasiums_statistics_and_vectors_take_the_infos() -> None:
    options = {**HIDDEN, "max_cycles": 4}
    env = gymnasium.wrappers.RecordEpisodeStatistics(
        Flatten(DrivingRows(gymnasium.make("coopsim/occluded_pedestrian-v3", **options)))
    )
    infos, rewards = play(env, np.float32([0.0]), 0)
    assert infos[-1]["episode"]["r"] == pytest.approx(sum(rewards)) and infos[-1]["is_success"]
    wrap = {"agents": "single", "wrap": [DrivingRows, Flatten], "workers": 0, "autoreset_mode": "SameStep"}
    with coopsim.vector("occluded_pedestrian", 2, **wrap, **options) as made:
        vector = gymnasium.wrappers.vector.RecordEpisodeStatistics(made)
        vector.reset(seed=[0, 1])
        for _ in range(4):
            _, reward, _, _, info = vector.step(np.zeros((2, 1), np.float32))
    final = info["final_info"]
    assert final["is_success"].dtype == np.bool_ and final["is_success"].all()
    assert list(final["end"]) == ["max_cycles"] * 2
    parts = final["reward_parts"]
    assert parts["progress"] + parts["comfort"] + parts["crash"] == pytest.approx(reward)
    assert info["episode"]["l"].tolist() == [4, 4]


def test_stable_baselines_logs_the_share_of_successes() -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    env = Flatten(DrivingRows(coopsim.single_env("occluded_pedestrian", **HIDDEN, max_cycles=4), tracks=2))
    model = sb3.PPO("MlpPolicy", env, n_steps=8, batch_size=8, n_epochs=1, device="cpu", seed=0)
    model.learn(8)
    assert list(model.ep_success_buffer) == [True, True]
