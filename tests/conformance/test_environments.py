"""Every environment keeps PettingZoo's rules and ours, step after step."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test
from representatives import all_of
from small_env import SIMULATED, SMALL

import coopsim
from coopsim.types import seconds_to_ns

Make = Callable[..., Any]

OF_EACH_KIND = pytest.mark.parametrize("name", all_of(SIMULATED, "crossing", "highway", "town"))
"""A junction of a layout, a road without junctions, and a drawn town."""

CONTROLS = "traffic", "policy", "acceleration", "planner"
WAYS = [*(("crossing", control) for control in CONTROLS), ("highway", "policy"), ("town", "planner")]
OTHER_WAYS = [
    pytest.param(*way, marks=pytest.mark.long) for way in itertools.product(SIMULATED, CONTROLS) if way not in WAYS
]


def assert_same(a: Any, b: Any, where: str = "") -> None:
    """Equal to the last bit, through all levels."""
    if isinstance(a, Mapping):
        assert a.keys() == b.keys(), where
        for key in a:
            assert_same(a[key], b[key], f"{where}/{key}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)
    else:
        assert a == b, where


def play(env: Any, seed: int, policy: str = "late_fusion") -> list[Any]:
    """Everything that an episode gives."""
    tracker = coopsim.make_policy(policy)
    observations, infos = env.reset(seed=seed)
    tracker.reset(env.agent_specs, seed=seed)
    history: list[Any] = [(observations, infos)]
    while env.agents:
        history.append(env.step(tracker.act(observations)))
        observations = history[-1][0]
    assert len(history) > 1 and all(step[0] for step in history)
    return history


@pytest.mark.parametrize(("name", "control"), [*WAYS, *OTHER_WAYS])
# Random tracks are rarely plausible; what they must not do is crash the scoring.
@pytest.mark.filterwarnings("ignore:reset option 'options' is ignored")
def test_parallel_api(make_small: Make, name: str, control: str) -> None:
    parallel_api_test(make_small(name, control=control), num_cycles=15)


@pytest.mark.filterwarnings("ignore:reset option 'options' is ignored")
def test_parallel_api_of_replay(recordings: Any) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections=("ego", "1"))
    parallel_api_test(env, num_cycles=15)


@OF_EACH_KIND
def test_parallel_seed(make_small: Make, name: str) -> None:
    """It stops after one step; `test_same_seed_same_bits_step_after_step` does not. But it seeds the spaces."""
    parallel_seed_test(lambda: make_small(name, control="policy"), 5)


@pytest.mark.parametrize("name", [f"coopsim/{name}-v3" for name in SIMULATED])
def test_pettingzoo_makes_registered_ids(name: str) -> None:
    env = pettingzoo.make("parallel", name, **SMALL)
    assert env.metadata["name"] == name
    assert str(coopsim.parallel_env(name, **SMALL)) == name


@pytest.mark.parametrize("name", SIMULATED)
def test_observations_actions_and_state_are_in_their_spaces(make_small: Make, name: str) -> None:
    env = make_small(name, lidar_columns=32, control="policy", max_cycles=4)
    policy = coopsim.make_policy("late_fusion")
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs)
    assert env.agents
    while env.agents:
        actions = policy.act(observations)
        for agent in env.agents:
            assert env.observation_space(agent) is env.observation_space(agent)
            assert env.observation_space(agent).contains(observations[agent]), agent
            assert env.action_space(agent).contains(actions[agent]), agent
        assert env.state_space.contains(env.state())
        observations, *_ = env.step(actions)


@pytest.mark.parametrize("name", SIMULATED)
def test_agents_are_removed_when_the_episode_is_truncated(make_small: Make, name: str) -> None:
    env = make_small(name, max_cycles=3)
    *_, last = play(env, seed=0)
    observations, rewards, terminations, truncations, infos = last
    agents = set(env.possible_agents)
    assert env.agents == []
    assert set(observations) == set(rewards) == set(infos) == agents
    assert truncations == dict.fromkeys(agents, True)
    assert terminations == dict.fromkeys(agents, False)


@pytest.mark.parametrize(
    ("name", "steps"),
    [("crossing", 15), ("highway", 10), ("town", 10)]
    + [pytest.param(name, 30, marks=pytest.mark.long) for name in SIMULATED]
    + [pytest.param(name, 200, marks=pytest.mark.long) for name in ("crossing", "highway")],
)
def test_same_seed_same_bits_step_after_step(make_small: Make, name: str, steps: int) -> None:
    noisy = {
        "position_noise_m": 0.2,
        "latency_s": 0.15,
        "latency_jitter_s": 0.1,
        "loss": 0.1,
        "max_cycles": steps,
    }
    first, again = (play(make_small(name, **noisy), seed=11) for _ in range(2))
    assert len(first) == steps + 1
    for k, (a, b) in enumerate(zip(first, again, strict=True)):
        for part_a, part_b in zip(a, b, strict=True):
            assert_same(part_a, part_b, f"step {k}")


@pytest.mark.parametrize("policy", ["late_fusion", "track_to_track"])
def test_an_environment_that_was_used_before_starts_afresh(make_small: Make, policy: str) -> None:
    def make() -> Any:
        return make_small(uplink=coopsim.POLICIES.get(policy).needs.uplink, latency_s=0.1)

    used = make()
    play(used, 1, policy)
    used.reset(seed=3)  # and left in the middle
    for again, first in zip(play(used, 2, policy), play(make(), 2, policy), strict=True):
        assert_same(dict(enumerate(again)), dict(enumerate(first)))


@pytest.mark.parametrize("name", SIMULATED)
def test_another_seed_gives_another_episode(make_small: Make, name: str) -> None:
    a, b = (make_small(name).reset(seed=seed)[0]["cav_0"] for seed in (1, 2))
    assert not np.array_equal(a["pose"], b["pose"])
    assert not np.array_equal(a["sweeps"]["lidar"], b["sweeps"]["lidar"])


@OF_EACH_KIND
@pytest.mark.parametrize("more", [{"connected_cars": 3}, {"rsus": 2}])
def test_one_agent_more_leaves_the_others_as_they_were(make_small: Make, name: str, more: dict[str, int]) -> None:
    noisy: dict[str, Any] = {"position_noise_m": 0.2, "heading_noise_rad": 0.01, "latency_s": 0.05}
    noisy |= {"latency_jitter_s": 0.1, "max_cycles": 6}
    few = make_small(name, **noisy, connected_cars=2, rsus=1)
    many = make_small(name, **noisy, **({"connected_cars": 2, "rsus": 1} | more))
    old = few.possible_agents
    (new,) = set(many.possible_agents) - set(old)
    for (a, *_), (b, *_) in zip(play(few, seed=5), play(many, seed=5), strict=True):
        for agent in old:
            for key in ("time_ns", "pose", "odometry", "detections", "sweeps"):
                assert_same(a[agent][key], b[agent][key], f"{agent}/{key}")
            heard_a, heard_b = (
                [
                    (env.possible_agents[sender], captured)
                    for sender, captured in zip(o["inbox"]["sender"], o["inbox"]["captured_ns"], strict=True)
                ]
                for env, o in ((few, a[agent]), (many, b[agent]))
            )
            assert heard_a == [heard for heard in heard_b if heard[0] != new]


@pytest.mark.parametrize("dt_s", [0.1, 1 / 30, 1 / 3])
@pytest.mark.parametrize("frames", [0, 1, 2])
def test_a_latency_of_n_frames_is_n_frames(make_small: Make, dt_s: float, frames: int) -> None:
    for k, step in enumerate(play(make_small(dt_s=dt_s, latency_s=frames * dt_s), seed=0)):
        captured = step[0]["cav_0"]["inbox"]["captured_ns"]
        expected = [seconds_to_ns((k - frames) * dt_s)] * 3 if k >= frames else []
        assert captured.tolist() == expected


def test_ground_truth_is_only_where_it_was_asked_for(make_small: Make) -> None:
    hidden, shown = make_small(), make_small(expose_ground_truth=True)
    _, infos = hidden.reset(seed=0)
    assert set(infos["cav_0"]) == {"seed"}
    observations, infos = shown.reset(seed=0)
    truth = infos["cav_0"]["ground_truth"]
    assert len(truth["id"]) == len(truth["box"]) == len(truth["label"]) > 0
    assert len(infos["cav_0"]["instances"]["lidar"]) == len(observations["cav_0"]["sweeps"]["lidar"])
    assert observations["cav_0"].keys() == hidden.reset(seed=0)[0]["cav_0"].keys()


def test_writing_into_the_truth_that_was_handed_out_changes_no_score(make_small: Make) -> None:
    def score(write: bool) -> Any:
        env = make_small(expose_ground_truth=True, max_cycles=3)
        policy = coopsim.make_policy("no_fusion")
        observations, infos = env.reset(seed=0)
        policy.reset(env.agent_specs)
        while env.agents:
            for info in infos.values() if write else ():
                for column in info["ground_truth"].values():
                    column[:] = 7
            observations, _, _, _, infos = env.step(policy.act(observations))
        return env.score().to_dict()

    assert_same(score(write=True), score(write=False))


def test_truth_that_counts_is_in_the_region_and_was_hit_by_somebody(make_small: Make) -> None:
    env = make_small(expose_ground_truth=True, vehicles=25, lidar_columns=512)
    _, infos = env.reset(seed=0)
    hit = np.unique(np.concatenate([info["instances"]["lidar"] for info in infos.values()]))
    everything, infos_all = make_small(expose_ground_truth=True, vehicles=25, ground_truth="all"), {}
    _, infos_all = everything.reset(seed=0)
    fewer = []
    for agent in env.agents:
        truth, all_truth = infos[agent]["ground_truth"], infos_all[agent]["ground_truth"]
        counted, all_counted = truth["id"][truth["counts"]], all_truth["id"][all_truth["counts"]]
        assert np.isin(counted, hit).all()
        assert (np.abs(truth["box"][truth["counts"], :2]) <= [100, 40]).all()
        assert set(counted) == set(all_counted) & set(hit)
        np.testing.assert_array_equal(truth["in_region"], (np.abs(truth["box"][:, :2]) <= [100, 40]).all(axis=1))
        np.testing.assert_array_equal(all_truth["counts"], all_truth["in_region"])
        fewer.append(len(counted) < len(all_counted))
    assert any(fewer)


def test_control_by_policy_moves_the_car(make_small: Make) -> None:
    def drive(maneuver: int) -> float:
        env = make_small("highway", control="policy", max_cycles=30)
        policy = coopsim.make_policy("no_fusion")
        policy.drive = lambda agent, observation: maneuver  # type: ignore[method-assign]
        observations, _ = env.reset(seed=3)
        policy.reset(env.agent_specs)
        travelled = 0.0
        while env.agents:
            observations, *_ = env.step(policy.act(observations))
            travelled += float(observations["cav_0"]["odometry"][0])
        return travelled

    slower, faster = (
        drive(coopsim.envs.MANEUVERS.index("slower")),
        drive(coopsim.envs.MANEUVERS.index("faster")),
    )
    assert faster > slower + 5


def test_fresh_seeds_differ_and_are_told(make_small: Make) -> None:
    env = make_small()
    seeds = {env.reset()[1]["cav_0"]["seed"] for _ in range(3)}
    assert len(seeds) == 3
    again, _ = env.reset(seed=seeds.pop())
    assert again["cav_0"]["time_ns"] == 0
