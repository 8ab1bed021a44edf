"""What a vector does, whatever its workers are: here in the calling process."""

from __future__ import annotations

import threading
from typing import Any

import gymnasium
import numpy as np
import pytest
from counting_envs import FAILING, REFUSED, CountingAgents, CountingEnv, SeededEnv
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import coopsim
from coopsim.errors import (
    EpisodeStateError,
    InvalidActionError,
    InvalidValueError,
    LostEnvironmentsError,
    UnknownNameError,
)

MODES = list(AutoresetMode)


def single(count: int = 3, **options: Any) -> Any:
    return coopsim.vector(CountingEnv, count, **({"workers": 0} | options))


def several(count: int = 3, **options: Any) -> Any:
    return coopsim.vector(CountingAgents, count, **({"workers": 0} | options))


def acts(*actions: float) -> Any:
    return np.array(actions, np.float32)[:, None]


def each(*actions: float) -> list[dict[str, float]]:
    return [{"a": action, "b": 1.0} for action in actions]


def assert_same(ours: Any, theirs: Any) -> None:
    """Equal, in depth; the seeds of resets are ours alone."""
    assert type(ours) is type(theirs)
    if isinstance(ours, dict):
        assert set(ours) == set(theirs)
        for key in ours.keys() - {"seed"}:
            assert_same(ours[key], theirs[key])
    elif isinstance(ours, tuple) or (isinstance(ours, np.ndarray) and ours.dtype == object):
        for one, other in zip(ours, theirs, strict=True):
            assert_same(one, other)
    else:
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("mode", MODES)
def test_as_gymnasium_does(mode: AutoresetMode) -> None:
    """Spaces, batches, infos and autoreset are those of gymnasium's own vector of the same environment."""
    theirs = SyncVectorEnv([CountingEnv] * 3, autoreset_mode=mode)
    rng = np.random.default_rng(0)
    with single(autoreset_mode=mode) as ours:
        assert ours.observation_space == theirs.observation_space and ours.action_space == theirs.action_space
        assert ours.metadata["autoreset_mode"] is mode and ours.num_envs == 3
        assert_same(ours.reset(seed=[1, 2, 3]), theirs.reset(seed=[1, 2, 3]))
        for _ in range(20):
            actions = rng.random((3, 1)).astype(np.float32)
            one, other = ours.step(actions), theirs.step(actions)
            assert_same(one, other)
            over = one[2] | one[3]
            if mode is AutoresetMode.DISABLED and over.any():
                masks = [{"reset_mask": over.copy()} for _ in range(2)]
                assert_same(ours.reset(options=masks[0]), theirs.reset(options=masks[1]))
        assert_same(ours.render(), theirs.render())


def test_nested_and_varying_observations_are_batched_as_gymnasium_does() -> None:
    class Nested(CountingEnv):
        def __init__(self) -> None:
            super().__init__()
            rows = spaces.Sequence(spaces.Box(0, 9, (2,)), stack=True)
            self.observation_space = spaces.Dict({"now": spaces.Discrete(9), "rows": rows})

        def _observed(self) -> Any:
            return {"now": self.steps, "rows": np.ones((self.steps, 2), np.float32)}

    theirs = SyncVectorEnv([Nested] * 2)
    with coopsim.vector(Nested, 2, workers=0) as ours:
        assert_same(ours.reset(seed=1)[0], theirs.reset(seed=1)[0])
        assert_same(ours.step(acts(1, 1))[0], theirs.step(acts(1, 1))[0])


@pytest.mark.parametrize("mode", MODES)
def test_many_agents(mode: AutoresetMode) -> None:
    with several(2, autoreset_mode=mode) as vector:
        observations, infos = vector.reset(seed=5)
        assert vector.possible_agents == ["a", "b"] and vector.action_space("a") == spaces.Box(-9.0, 9.0)
        first = [info["a"]["seed"] for info in infos]
        assert len(set(first)) == 2 and observations[0]["a"]["rows"].shape == (0, 2)
        for _ in range(3):
            observations, rewards, terminations, truncations, infos = vector.step(each(2.0, 3.0))
        assert rewards == [{"a": 2.0, "b": 1.0}, {"a": 3.0, "b": 1.0}]
        assert truncations == [{"a": True, "b": True}] * 2 and terminations == [{"a": False, "b": False}] * 2
        if mode is AutoresetMode.SAME_STEP:
            assert [observed["a"]["rows"].shape for observed in observations] == [(0, 2)] * 2
            assert infos[0]["a"]["final_obs"]["rows"].shape == (3, 2)
            assert infos[0]["a"]["final_info"] == {"steps": 3}
            assert infos[0]["a"]["seed"] not in first
            return
        assert [observed["a"]["rows"].shape for observed in observations] == [(3, 2)] * 2
        assert vector.call("score") == tuple((seed, 3) for seed in first)
        if mode is AutoresetMode.DISABLED:
            with pytest.raises(EpisodeStateError, match="environments 0, 1 are over"):
                vector.step(each(1, 1))
            observations, infos = vector.reset(options={"reset_mask": np.array([False, True])})
            assert infos[0] == {} and infos[1]["a"]["seed"] not in first
            assert [observed["a"]["rows"].shape for observed in observations] == [(3, 2), (0, 2)]
        else:
            observations, rewards, _, truncations, infos = vector.step(each(9, 9))
            assert rewards == [{"a": 0.0, "b": 0.0}] * 2 and truncations == [{"a": False, "b": False}] * 2
            assert infos[0]["a"]["seed"] not in first and observations[0]["a"]["rows"].shape == (0, 2)


def test_seeds() -> None:
    with several(2, seed=4) as vector:

        def seeds(**options: Any) -> list[int]:
            return [info["a"]["seed"] for info in vector.reset(**options)[1]]

        first, second = seeds(), seeds()
        assert len({*first, *second}) == 4
        assert seeds(seed=4) == first and seeds() == second
        assert seeds(seed=[8, 9]) == [8, 9]
        assert seeds(seed=[None, 9])[1] == 9
    with several(4, seed=4) as larger:
        assert [info["a"]["seed"] for info in larger.reset()[1]][:2] == first


def test_a_refused_action_loses_nothing() -> None:
    """The others have stepped once, whatever is called how often."""
    with single() as vector, single() as other:
        vector.reset(seed=0), other.reset(seed=0)
        for _ in range(2):
            with pytest.raises(InvalidActionError, match=r"environment 1: action must be >= 0.*environments 1"):
                vector.step(acts(5, REFUSED, 6))
        got = vector.step(acts(0, 7, REFUSED))
        want = other.step(acts(5, 7, 6))
        assert_same(got, want)
        assert_same(vector.step(acts(1, 1, 1)), other.step(acts(1, 1, 1)))


def test_an_environment_that_raises_is_truncated_and_goes_on() -> None:
    with single() as vector:
        vector.reset(seed=0)
        with pytest.raises(LostEnvironmentsError, match=r"lost environment 1: (?s:.*)the detector broke") as raised:
            vector.step(acts(1, FAILING, 2))
        assert list(raised.value.reports) == [1] and "Traceback" in raised.value.reports[1]
        observations, rewards, terminations, truncations, infos = raised.value.results
        np.testing.assert_array_equal(observations[:, 1], [1, 0, 1])
        assert rewards.tolist() == [1, 0, 2] and not terminations.any()
        assert truncations.tolist() == [False, True, False] and "detector broke" in infos["error"][1]
        observations, *_ = vector.step(acts(1, 1, 1))
        np.testing.assert_array_equal(observations[:, :2], [[0, 2], [1, 0], [0, 2]])


def test_a_lost_environment_waits_for_its_reset_where_autoreset_is_disabled() -> None:
    with several(2, autoreset_mode="Disabled") as vector:
        vector.reset(seed=0)
        with pytest.raises(LostEnvironmentsError) as raised:
            vector.step(each(FAILING, 1))
        assert raised.value.results[3] == [{"a": True, "b": True}, {"a": False, "b": False}]
        with pytest.raises(EpisodeStateError, match="environments 0 are over"):
            vector.step(each(1, 1))
        vector.reset(options={"reset_mask": np.array([True, False])})
        observations, *_ = vector.step(each(1, 1))
        assert [len(observed["a"]["rows"]) for observed in observations] == [1, 2]


def test_a_lost_environment_in_same_step_mode_has_its_last_observation() -> None:
    with single(2, autoreset_mode="SameStep") as vector:
        vector.reset(seed=0)
        vector.step(acts(1, 1))
        with pytest.raises(LostEnvironmentsError) as raised:
            vector.step(acts(FAILING, 1))
        *_, truncations, infos = raised.value.results
        assert truncations.tolist() == [True, False] and infos["_final_obs"].tolist() == [True, False]
        np.testing.assert_array_equal(infos["final_obs"][0], [0, 1, 0])
        assert "detector broke" in infos["final_info"]["error"][0]
    with several(2, autoreset_mode="SameStep") as agents:
        agents.reset(seed=0)
        with pytest.raises(LostEnvironmentsError) as raised:
            agents.step(each(FAILING, 1))
        info = raised.value.results[4][0]["a"]
        assert info["final_obs"]["rows"].shape == (0, 2) and "detector broke" in info["final_info"]["error"]


def test_an_episode_ends_properly_in_same_step_mode_where_the_next_cannot_begin() -> None:
    class Once(CountingEnv):
        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
            if self.episode == 0:
                self.episode = 1
                raise ZeroDivisionError("no second one")
            return super().reset(seed=seed, options=options)

    with coopsim.vector(Once, 1, workers=0, length=2, autoreset_mode="SameStep") as vector:
        vector.reset(seed=0)
        vector.step(acts(1))
        _, rewards, terminations, _, infos = vector.step(acts(5))
        assert rewards.tolist() == [5] and terminations.tolist() == [True]
        np.testing.assert_array_equal(infos["final_obs"][0], [0, 2, 0])
        with pytest.raises(LostEnvironmentsError, match="no second one"):
            vector.step(acts(1))
        assert vector.step(acts(1))[0][:, :2].tolist() == [[2, 0]]


def test_a_reset_with_losses_has_the_results_of_the_others() -> None:
    class Odd(CountingEnv):
        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
            if options and seed == 1:
                raise ZeroDivisionError("odd")
            return super().reset(seed=seed, options=options)

    with coopsim.vector(Odd, 2, workers=0) as vector:
        with pytest.raises(LostEnvironmentsError) as raised:
            vector.reset(seed=[0, 1], options={"x": 1})
        assert raised.value.results is None  # there is no observation to put in the batch
        vector.reset(seed=[0, 1])
        with pytest.raises(LostEnvironmentsError) as raised:
            vector.reset(seed=[0, 1], options={"x": 1})
        observations, infos = raised.value.results
        assert observations.shape == (2, 3) and infos["_seed"].tolist() == [True, False]
        vector.reset(options={"reset_mask": np.array([False, True])})
        assert vector.step(acts(1, 1))[0][:, 1].tolist() == [1, 1]


def test_a_masked_reset_returns_the_observations_of_those_that_go_on_once_more() -> None:
    with several(2) as vector:
        vector.reset(seed=0)
        observations, *_ = vector.step(each(1, 1))
        again, _ = vector.reset(options={"reset_mask": np.array([False, True])})
        np.testing.assert_array_equal(again[0]["a"]["rows"], observations[0]["a"]["rows"])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"count": 0}, "count must be an integer >= 1, got 0"),
        ({"count": 2.0}, "count must be an integer"),
        ({"workers": -1}, "workers must be an integer >= 0, got -1"),
        ({"workers": True}, "workers must be"),
        ({"agents": "one"}, "unknown agents 'one'.*Accepted: all, single"),
        ({"backend": "ray"}, "unknown backend 'ray' .vectors no longer run on Ray"),
        ({"autoreset_mode": "later"}, "autoreset_mode must be one of 'NextStep', 'SameStep', 'Disabled', got 'later'"),
        ({"seed": -1}, "seed must be an integer >= 0"),
        ({"wrap": 3}, "wrap must be a function"),
        ({"environment": "crosing"}, "unknown environment 'crosing'. Did you mean 'crossing"),
        ({"environment": 3}, "environment must be a name"),
        ({"environment": "crossing", "vehicels": 3}, "unknown option 'vehicels'"),
        ({"environment": "crossing", "worker": 0}, "Did you mean 'workers'"),
        ({"environment": "crossing", "num_envs": 2}, "number of environments is `count`"),
        ({"environment": "crossing", "tracker": "late_fusion"}, 'unknown option .tracker. without agents="single"'),
        ({"agents": "all"}, "agents must be 'single' or left out"),
        ({"environment": CountingAgents, "agents": "single"}, "agents must be 'all' or left out"),
        ({"seed": 2**63}, "seed must be < 2"),
        ({"environment": dict}, "got a dict"),
        ({"wrap": lambda env: {}[env]}, "CountingEnv"),
        ({"lock": threading.Lock()}, "such as can be pickled"),
    ],
)
def test_wrong_arguments(wrong: dict[str, Any], message: str) -> None:
    given = {"environment": CountingEnv, "count": 2, "workers": 0} | wrong
    with pytest.raises((InvalidValueError, UnknownNameError, KeyError), match=message):
        coopsim.vector(given.pop("environment"), given.pop("count"), **given)


def test_wrong_calls_change_nothing() -> None:
    with single() as vector, single() as other:
        with pytest.raises(EpisodeStateError, match="call reset first"):
            vector.step(acts(1, 1, 1))
        with pytest.raises(EpisodeStateError, match="first reset must be of all"):
            vector.reset(options={"reset_mask": np.array([True, False, False])})
        with pytest.raises(InvalidValueError, match="options must be right"):
            vector.reset(seed=3, options={"wrong": 1})
        vector.reset(seed=0), other.reset(seed=0)
        vector.step(acts(1, 2, 3)), other.step(acts(1, 2, 3))
        for options in ([1], "abc", 3):
            with pytest.raises(InvalidValueError, match="options of reset must be a mapping"):
                vector.reset(options=options)
        with pytest.raises(UnknownNameError, match="Did you mean 'reset_mask'"):
            vector.reset(options={"resetmask": np.array([True, False, False])})
        for seed in (-1, "a", [1], [1, 2, -3], 1.5, 2**63, [2**70, 1, 2]):
            with pytest.raises(InvalidValueError, match="seed must"):
                vector.reset(seed=seed)
        for mask in ([True] * 3, np.ones(2, bool), np.zeros(3, bool), np.ones(3)):
            with pytest.raises(InvalidValueError, match="reset_mask must be"):
                vector.reset(options={"reset_mask": mask})
        with pytest.raises(InvalidValueError, match="options must be right"):
            vector.reset(seed=9, options={"wrong": 1})
        for wrong in (acts(1, 1), acts(1, 1, 1, 1), 3, None):
            with pytest.raises(InvalidActionError, match="actions must be"):
                vector.step(wrong)
        with pytest.raises(AttributeError):
            vector.call("no_such_thing")
        with pytest.raises(InvalidValueError, match="values must be 3"):
            vector.set_attr("length", [1, 2])
        assert_same(vector.step(acts(1, 2, 3)), other.step(acts(1, 2, 3)))
    with pytest.raises(EpisodeStateError, match="closed"):
        vector.step(acts(1, 1, 1))
    with several(2) as agents:
        agents.reset(seed=0)
        for wrong in (each(1), {"a": 1}, 3, None):
            with pytest.raises(InvalidActionError, match="actions are a list of 2 dicts"):
                agents.step(wrong)
        with pytest.raises(UnknownNameError, match="unknown agent 'c'"):
            agents.action_space("c")


def test_attributes_and_methods_of_the_environments() -> None:
    with single(2) as vector:
        vector.reset(seed=0)
        vector.set_attr("length", [1, 9])
        assert vector.get_attr("length") == (1, 9)
        vector.set_attr("length", 4)
        assert vector.get_attr("length") == (4, 4)
        assert [picture.shape for picture in vector.render()] == [(2, 2, 3)] * 2


def test_environments_share_nothing() -> None:
    """An object among the options is copied for each, so that it does not matter which share a process."""

    class Appending(CountingEnv):
        def __init__(self, seen: list[int]) -> None:
            super().__init__()
            self.seen = seen

        def step(self, action: Any) -> Any:
            self.seen.append(int(action[0]))
            return super().step(action)

    with coopsim.vector(Appending, 2, workers=0, seen=[]) as vector:
        vector.reset()
        vector.step(acts(3, 4))
        assert vector.get_attr("seen") == ([3], [4])


def test_wrappers_are_applied_the_innermost_first() -> None:
    wrap = [
        lambda env: gymnasium.wrappers.TransformReward(env, lambda reward: reward + 1),
        lambda env: gymnasium.wrappers.TransformReward(env, lambda reward: reward * 10),
    ]
    with coopsim.vector(SeededEnv, 2, workers=0, wrap=wrap) as vector:
        vector.reset(seed=0)
        assert vector.step(acts(1, 2))[1].tolist() == [20, 30]


def test_close_may_be_called_again() -> None:
    vector = single()
    vector.close()
    vector.close()
    assert vector.closed
