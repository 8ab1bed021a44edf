"""Rewards of drives: progress is worth its time, and a crash, a jerk and hard braking cost."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.catalog import REWARDS
from coopsim.envs import DriveReward, DriveStep, MotaReward, Reward, SafeProgress
from coopsim.envs.rewards import make_reward, total
from coopsim.envs.wrappers import Driving
from coopsim.errors import CoopsimError, InvalidValueError, RewardWarning, UnknownNameError
from coopsim.metrics.evaluator import FrameCounts
from coopsim.types.driving import CarState, Route
from coopsim.types.messages import MANEUVERS

LIMIT_M_S = 10.0
COUNTS = FrameCounts(tp=0, fp=0, fn=0, idsw=0, gt=0)
REWARD = SafeProgress()
QUICK: dict[str, Any] = {"lidar": None, "vehicles": 1, "connected_cars": 1, "pedestrians": 0, "rsus": 0}


def route(bend: float = 0.0) -> Route:
    """Return a route of 100 m that turns left by `bend` rad/m."""
    heading = bend * np.arange(101.0)
    points = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    return Route(points - points[0], 1.0, np.full(101, LIMIT_M_S), np.zeros(101, int))


def car(acceleration: float = 0.0, *, crashed: bool = False, bend: float = 0.0) -> CarState:
    return CarState(10.0, acceleration, 4.5, 1.8, crashed, route(bend))


def step(moved: tuple[float, float] = (1.0, 0.0), dt_s: float = 0.1, **changes: Any) -> DriveStep:
    """Return a step at the speed limit without acceleration, or with these changes."""
    return replace(DriveStep(COUNTS, dt_s, car(), car(), np.array(moved)), **changes)


def test_a_second_at_the_limit_is_worth_1_for_any_frame_time() -> None:
    for dt_s in (0.05, 0.1, 0.5):
        one = REWARD(step((LIMIT_M_S * dt_s, 0.0), dt_s))
        assert one / dt_s == pytest.approx(1.0)


def test_standing_still_earns_nothing_and_slower_is_worth_less() -> None:
    assert REWARD(step((0.0, 0.0))) == 0.0
    worth = [REWARD(step((metres, 0.0))) for metres in (0.0, 0.25, 0.5, 1.0)]
    assert worth == pytest.approx([0.0, 0.025, 0.05, 0.1])


def test_speeding_earns_nothing() -> None:
    assert REWARD(step((1.5, 0.0))) == pytest.approx(REWARD(step((1.0, 0.0))))


def test_progress_is_measured_along_the_route() -> None:
    """A car that moves aside makes no progress, and one in a bend is not cheated of the arc's length."""
    assert REWARD(step((0.0, 0.5))) == 0.0
    bent = car(bend=0.05)
    place = bent.route.points[12]
    assert DriveStep(COUNTS, 1.0, bent, bent, place).progress_m == pytest.approx(12.0, abs=0.05)
    assert float(np.hypot(*place)) < 11.9


def test_a_crash_costs_once() -> None:
    crash = REWARD(step(after=car(crashed=True)))
    assert crash == pytest.approx(REWARD(step()) - REWARD.crash)
    wreck = car(crashed=True)
    assert REWARD(step((0.0, 0.0), before=wreck, after=wreck)) == 0.0


def test_a_jerk_costs_and_more_where_it_is_greater() -> None:
    costs = [REWARD(step()) - REWARD(step(before=car(a))) for a in (0.1, -0.1, 0.2, 0.4)]
    assert costs[0] == pytest.approx(costs[1])
    assert 0 < costs[0] < costs[2] < costs[3]


def test_hard_braking_costs_more_than_soft_and_no_more_than_comfort() -> None:
    costs = [REWARD(step()) - REWARD(step(before=car(a), after=car(a))) for a in (-1.0, -3.0, -4.05, -8.0)]
    assert 0 < costs[0] < costs[1] < costs[2] == pytest.approx(costs[3])
    assert REWARD(step(before=car(8.0), after=car(-8.0))) == pytest.approx(REWARD(step()) - 0.1 * REWARD.comfort)


def test_a_lighter_crash_may_be_asked_for() -> None:
    made = make_reward("safe_progress(crash=2, comfort=0)")
    assert isinstance(made, SafeProgress) and made(step(after=car(crashed=True))) == pytest.approx(0.1 - 2.0)
    assert made(step(before=car(3.0))) == pytest.approx(0.1)


def test_rewards_have_names() -> None:
    assert {"mota", "safe_progress"} <= set(REWARDS.names())
    assert isinstance(make_reward(None), MotaReward) and isinstance(make_reward("mota"), MotaReward)
    assert make_reward(REWARD) is REWARD


@pytest.mark.parametrize(
    ("reward", "error", "says"),
    [
        ("safe_progres", UnknownNameError, "unknown reward 'safe_progres'. Did you mean 'safe_progress'"),
        ("safe_progress(crush=1)", UnknownNameError, "unknown parameter 'crush' of reward 'safe_progress'"),
        ("safe_progress(crash=-1)", InvalidValueError, "crash must be a finite number >= 0, got -1"),
        (SafeProgress, InvalidValueError, r"a name or None, got .*: write SafeProgress\(\)"),
        (len, InvalidValueError, "reward must be a coopsim Reward, DriveReward or MessageGain, a name or None, got"),
        (Reward, InvalidValueError, "reward must be"),
    ],
)
def test_a_wrong_reward_is_told(reward: Any, error: type[CoopsimError], says: str) -> None:
    with pytest.raises(error, match=says):
        make_reward(reward)


@pytest.mark.parametrize("options", [{"control": "traffic"}, {"control": "policy", "traffic": "highway-env"}])
def test_rewards_of_drives_need_drives(options: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError, match=r'is of driven cars: it needs .*, "policy" or .* traffic="arrays"'):
        coopsim.parallel_env("crossing", lidar=None, reward="safe_progress", **options)


def test_lane_changes_and_speeds_by_maneuvers_earn_safe_progress() -> None:
    """A car that goes faster earns more than one that slows down to a stand."""
    env = coopsim.single_env("crossing", control="policy", tracker="no_fusion", reward="safe_progress", **QUICK)
    earned = {}
    for name in ("faster", "slower"):
        env.reset(seed=2)
        earned[name] = sum(env.step(MANEUVERS.index(name))[1] for _ in range(12))
    assert earned["faster"] > earned["slower"] + 0.3


def test_parts_of_safe_progress_are_named_and_add_up() -> None:
    crash = step(before=car(1.0), after=car(-3.0, crashed=True))
    parts = REWARD.parts(crash)
    assert set(parts) == {"progress", "comfort", "crash"}
    assert sum(parts.values()) == pytest.approx(REWARD(crash)) and REWARD(crash) == total(parts)
    assert (parts["progress"], parts["crash"]) == (pytest.approx(0.1), -5.0) and parts["comfort"] < 0


def test_a_class_that_changes_the_whole_is_asked_for_the_whole() -> None:
    class Bolder(SafeProgress):
        def __call__(self, step: DriveStep) -> float:
            return 1.0 + super().__call__(step)

    assert Bolder().parts(step()) == {"reward": pytest.approx(1.0 + REWARD(step()))}


@pytest.mark.parametrize("control", ["acceleration", "policy"])
def test_a_driver_under_the_reward_of_tracks_is_warned(control: str) -> None:
    with pytest.warns(RewardWarning, match='"mota": it scores tracks, .* choose reward="safe_progress"'):
        coopsim.single_env("crossing", control=control, tracker="no_fusion", **QUICK)
    with pytest.warns(RewardWarning, match='reward="safe_progress"'):
        Driving(coopsim.parallel_env("crossing", control=control, **QUICK), tracker="no_fusion")


def test_only_a_driver_without_a_reward_of_its_own_is_warned() -> None:
    """The reward was chosen, or the agent reports its tracks itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coopsim.single_env("crossing", control="acceleration", tracker="no_fusion", reward="mota", **QUICK)
        coopsim.single_env("crossing", control="acceleration", **QUICK)
        coopsim.single_env("crossing", **QUICK)


class Speed(DriveReward):
    def __call__(self, step: DriveStep) -> float:
        return step.after.speed_m_s


class Found(Reward):
    def __call__(self, counts: FrameCounts) -> float:
        return float(counts.tp)


def test_classes_of_users_reward_what_they_are_given() -> None:
    options: dict[str, Any] = {"lidar": None, "rsus": 1, "control": "planner", "driven_agents": ["cav_1"]}
    env = coopsim.parallel_env("crossing", max_cycles=5, reward=Speed(), **options)
    counted = coopsim.parallel_env("crossing", max_cycles=5, reward=Found(), **options)
    policies = [coopsim.make_policy("late_fusion") for _ in range(2)]
    seen = [each.reset(seed=2)[0] for each in (env, counted)]
    for each, policy in zip((env, counted), policies, strict=True):
        policy.reset(each.agent_specs)
    while env.agents:
        observations, rewards, *_ = env.step(policies[0].act(seen[0]))
        assert rewards == {name: (env.cars["cav_1"].speed_m_s if name == "cav_1" else 0.0) for name in rewards}
        also, found, _, _, infos = counted.step(policies[1].act(seen[1]))
        assert found == {name: float(info["counts"]["tp"]) for name, info in infos.items()}
        seen = [observations, also]
