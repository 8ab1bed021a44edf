"""Short names of taught parts, a whole episode in one call, and an environment that says what it is."""

from __future__ import annotations

import importlib
import subprocess
import sys
from typing import Any

import pytest

import coopsim
import coopsim.metrics

SIMPLE: dict[str, Any] = {"lidar": None, "vehicles": 4, "pedestrians": 0, "max_cycles": 4}


@pytest.mark.parametrize("package", ["coopsim", "coopsim.agents", "coopsim.bench", "coopsim.comms"])
def test_every_short_name_is_there(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__ and set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        module.nothing  # noqa: B018


def test_short_names_of_packages_are_loaded_when_first_used() -> None:
    heavy = ("torch", "pyarrow", "moderngl")
    code = f"import sys, coopsim.bench, coopsim.comms; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def same(one: coopsim.metrics.Score, other: coopsim.metrics.Score) -> bool:
    return repr(one.to_dict()) == repr(other.to_dict())


@pytest.mark.parametrize(
    ("policy", "options"),
    [
        ("late_fusion", {}),
        ("late_fusion(defense=robosac)", {"attacks": {"cav_1": "ghost"}}),  # draws random numbers
        ("late_fusion(defense=oracle)", {"attacks": {"cav_1": "ghost"}, "expose_ground_truth": True}),
    ],
)
def test_the_loop_that_users_write_measures_what_evaluate_does(policy: str, options: dict[str, Any]) -> None:
    made = coopsim.make_policy(policy)
    env = coopsim.parallel_env("crossing", uplink=made, **SIMPLE, **options)
    observations, infos = env.reset(seed=7)
    made.reset(env.agent_specs, seed=env.policy_seed)
    while env.agents:
        observations, _, _, _, infos = env.step(made.act(observations, infos))
    evaluation = coopsim.evaluate(policy, "crossing", seed=7, **SIMPLE, **options)
    assert same(env.score(), evaluation.score)
    assert ("attackers_found" in evaluation.score.values) is ("defense" in policy)


def test_an_episode_runs_in_one_call_in_an_environment_of_ones_own() -> None:
    policy = coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env("crossing", uplink=policy, seed=7, **SIMPLE)
    coopsim.run_episode(env, policy)
    evaluation = coopsim.evaluate("late_fusion", "crossing", seed=7, **SIMPLE)
    assert same(env.score(), evaluation.score) and env.channel_counts == evaluation.messages
    with pytest.warns(DeprecationWarning, match="run_episode"):
        assert same(coopsim.rollout(env, "late_fusion").score, evaluation.score)


def test_an_episode_refuses_an_environment_without_what_the_policy_needs() -> None:
    env = coopsim.parallel_env("crossing", uplink="none", **SIMPLE)
    with pytest.raises(coopsim.CoopsimError, match="uplink"):
        coopsim.run_episode(env, coopsim.make_policy("late_fusion"))


def test_an_environment_says_what_it_is() -> None:
    env = coopsim.parallel_env("crossing", **SIMPLE)
    shown = repr(env)
    assert "coopsim/crossing-v" in shown and "cav_0" in shown and "rsu_0" in shown and "no episode" in shown
    env.reset(seed=11)
    assert "seed 11" in repr(env)
