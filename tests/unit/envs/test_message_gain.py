"""The reward of messages: what receivers gain by hearing them, against the same receivers that never heard them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import InvalidValueError, PolicyMismatchError, UnknownNameError

ANY: dict[str, Any] = {"lidar": None, "max_cycles": 8, "detector": "simulated", "uplink": "action"}
SMALL: dict[str, Any] = ANY | {"vehicles": 20}


def run(reward: str, *, silent: tuple[str, ...] | None = None, name: str = "crossing", **options: Any) -> Any:
    """Run an episode of late fusion; return the environment, and the rewards and the MOTA by step and agent."""
    env = coopsim.parallel_env(name, reward=reward, **((SMALL if name == "crossing" else ANY) | options))
    policy = coopsim.make_policy("late_fusion")
    observations, infos = env.reset(seed=2)
    policy.reset(env.agent_specs, seed=coopsim.support.rng.derived_seed(2, "policy"))
    rewards, accuracy = [], []
    while env.agents:
        actions = policy.act(observations)
        for agent in env.agents if silent is None else silent:
            actions[agent]["message"] = None
        observations, earned, _, _, infos = env.step(actions)
        counts = [info["counts"] for info in infos.values()]
        rewards.append(list(earned.values()))
        accuracy.append([1 - (each["fp"] + each["fn"] + each["idsw"]) / max(each["gt"], 1) for each in counts])
    return env, np.array(rewards), np.array(accuracy)


def test_silence_earns_nothing() -> None:
    for share in ("own", "team"):
        _, rewards, _ = run(f"message_gain(share={share}, byte_price=1, load_price=1)")
        assert (rewards == 0).all()


def test_a_teams_gain_is_that_of_the_same_receivers_over_not_hearing() -> None:
    env, rewards, heard = run("message_gain(share=team)", silent=())
    _, _, unheard = run("message_gain(share=team)")
    # A step's reward is of the frame that it leads to, and its info of the frame before.
    np.testing.assert_allclose(rewards[:-1], (heard - unheard).mean(axis=1, keepdims=True)[1:] + 0 * rewards[:-1])
    assert (rewards != 0).any() and env.channel_counts.sent > 0


def test_an_own_gain_is_that_of_the_others_over_not_hearing_this_agent() -> None:
    _, rewards, heard = run("message_gain", silent=())
    _, _, unheard = run("message_gain", silent=("cav_1",))
    gain = np.delete(heard - unheard, 1, axis=1).mean(axis=1)
    np.testing.assert_allclose(rewards[:-1, 1], gain[1:])
    assert (gain != 0).any()


def test_gains_of_hota_add_up_to_the_episodes() -> None:
    with_all, rewards, _ = run("message_gain(share=team, metric=hota)", silent=())
    without, _, _ = run("message_gain(share=team)")
    gain = (with_all.score()["HOTA"] - without.score()["HOTA"]) / 100
    assert rewards[:-1, 0].sum() == pytest.approx(gain)
    assert gain != 0


def test_bytes_and_load_have_their_prices() -> None:
    env, free, _ = run("message_gain", silent=())
    _, priced, _ = run("message_gain(byte_price=2)", silent=())
    _, loaded, _ = run("message_gain(load_price=3)", silent=())
    seconds = env.time_ns / 1e9
    sent = np.array([env.bytes_per_s(name) * (seconds + 0.1) for name in env.possible_agents])
    np.testing.assert_allclose((free - priced).sum(axis=0), 2 * sent / 1000)
    np.testing.assert_allclose((free - loaded).sum(axis=0), 3 * 8 * sent.sum() / (6e6 * 0.1))


def test_avoided_braking_is_of_driven_cars() -> None:
    reward = "message_gain(metric=braking)"
    options = {"control": "acceleration", "max_cycles": 20}
    _, silent, _ = run(reward, name="occluded_pedestrian", **options)
    _, heard, _ = run(reward, silent=(), name="occluded_pedestrian", **options)
    assert (silent == 0).all() and np.isfinite(heard).all() and (np.abs(heard) <= 1).all()
    with pytest.raises(InvalidValueError, match="is of driven cars"):
        coopsim.parallel_env("crossing", reward=reward, **SMALL)


@pytest.mark.parametrize(
    ("reward", "kind", "match"),
    [
        ("message_gain(receiver=late_fuse)", UnknownNameError, "unknown policy 'late_fuse'"),
        ("message_gain(metric=mot)", UnknownNameError, "unknown metric 'mot'"),
        ("message_gain(share=all)", UnknownNameError, "unknown share 'all'"),
        ("message_gain(byte_price=-1)", InvalidValueError, "byte_price must be"),
        ("message_gain(receiver=early)", PolicyMismatchError, "needs uplink 'points'"),
    ],
)
def test_wrong_settings_are_refused(reward: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        coopsim.parallel_env("crossing", reward=reward, **SMALL)
