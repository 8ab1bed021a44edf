"""Short names of taught parts, a whole episode in one call, and an environment that says what it is."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import coopsim

SIMPLE = {"lidar": None, "vehicles": 4, "pedestrians": 0, "max_cycles": 4}


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


def test_a_rollout_is_an_evaluation_in_an_environment_of_ones_own() -> None:
    policy = coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env("crossing", uplink=policy, **SIMPLE)
    once, again = coopsim.rollout(env, policy, 7), coopsim.rollout(env, policy, seed=7)
    whole = coopsim.evaluate("late_fusion", "crossing", seed=7, **SIMPLE)
    assert dict(once.score.values) == dict(again.score.values) == dict(whole.score.values)
    assert once.frames == 4 and once.messages == whole.messages


def test_without_a_seed_a_rollout_takes_the_environments_own() -> None:
    env = coopsim.parallel_env("crossing", seed=5, **SIMPLE)
    assert dict(coopsim.rollout(env, "late_fusion").score.values) == dict(
        coopsim.rollout(env, "late_fusion", 5).score.values
    )


def test_a_rollout_refuses_an_environment_without_what_the_policy_needs() -> None:
    env = coopsim.parallel_env("crossing", uplink="none", **SIMPLE)
    with pytest.raises(coopsim.CoopsimError, match="uplink"):
        coopsim.rollout(env, "late_fusion", 0)


def test_an_environment_says_what_it_is() -> None:
    env = coopsim.parallel_env("crossing", **SIMPLE)
    shown = repr(env)
    assert "coopsim/crossing-v" in shown and "cav_0" in shown and "rsu_0" in shown and "no episode" in shown
    env.reset(seed=11)
    assert "seed 11" in repr(env)
