"""Learners of messages: numbers of fixed shape, in the order of the rows that they see."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

import coopsim
from coopsim.comms.envelope import decode_detections
from coopsim.envs.wrappers import BevImage, FixedSize, FixedTracks, Flatten, Speaking
from coopsim.errors import InvalidActionError, InvalidValueError
from coopsim.wire.observation_format import ObservationFormat

SMALL: dict[str, Any] = {"vehicles": 30, "lidar": None, "max_cycles": 6, "detector": "simulated"}


def make(uplink: str = "action", **options: Any) -> Any:
    return coopsim.parallel_env("crossing", uplink=uplink, reward="message_gain(share=team)", **(SMALL | options))


def inboxes(env: Any) -> dict[str, Any]:
    """Return the messages in the environment's last observations."""
    inner = env.unwrapped
    seen = ObservationFormat.to_unpack(inner.agent_specs).unpack_all(inner.episode.observations)
    return {name: {message.sender: message for message in each.inbox} for name, each in seen.items()}


@pytest.mark.parametrize("order", ["nearest", "surest"])
def test_a_score_is_that_of_the_row_that_the_learner_sees(order: str) -> None:
    env = FixedSize(Speaking(make()), detections=5, messages=0, order=order)
    observations, _ = env.reset(seed=3)
    assert env.action_space("cav_0").shape == (5,)
    row = int(observations["cav_0"]["detections_mask"].sum()) - 1
    assert row > 0
    actions = {name: np.full(5, -1, np.float32) for name in env.agents}
    actions["cav_0"][row] = 1.0
    env.step(actions)
    messages = inboxes(env)["cav_1"]
    assert set(messages) == {"cav_0"}
    (box,) = decode_detections(messages["cav_0"]).boxes.array
    np.testing.assert_allclose(box[:6], observations["cav_0"]["detections"][row, :6], rtol=1e-5, atol=1e-5)


def test_dicts_are_reordered_too() -> None:
    env = coopsim.single_env("crossing", tracker="late_fusion", others="late_fusion", uplink="action", **SMALL)
    env = FixedSize(env, detections=3, messages=0)
    shown, _ = env.reset(seed=3)
    assert env.action_space["score"].shape == (3,)
    env.step({"score": np.float32([0, 1, 0])})
    (box,) = decode_detections(inboxes_of(env)["cav_1"]["cav_0"]).boxes.array
    np.testing.assert_allclose(box[:6], shown["detections"][1, :6], rtol=1e-5, atol=1e-5)
    env.step(None)
    assert "cav_0" not in inboxes_of(env)["cav_1"]


def inboxes_of(env: Any) -> dict[str, Any]:
    return inboxes(env.unwrapped.parallel)


def test_another_number_of_scores_is_told() -> None:
    env = FixedSize(Speaking(make()), detections=5, messages=0)
    env.reset(seed=3)
    with pytest.raises(InvalidActionError, match=r"cav_0: action must have shape \(5,\), got \(64,\)"):
        env.step(dict.fromkeys(env.agents, np.zeros(64)))


def test_numbers_stand_for_masks_and_cells() -> None:
    env = Speaking(make("action(form=cells, cells=4, to=True)"))
    env.reset(seed=3)
    agents = len(env.possible_agents)
    assert env.action_space("cav_0").shape == (16 + agents,)
    everything = np.ones(16 + agents, np.float32)
    everything[16:] = -1
    everything[16 + env.possible_agents.index("cav_1")] = 1
    env.step(dict.fromkeys(env.agents, everything))
    heard = inboxes(env)
    assert heard["cav_1"] and not heard["cav_2"]
    with pytest.raises(InvalidActionError, match=r"cav_0: message must have shape \(20,\), got \(3,\)"):
        env.step(dict.fromkeys(env.agents, np.zeros(3)))


def test_a_picture_and_cells_share_a_square() -> None:
    BevImage(Speaking(make("action(form=cells, metres=60)")), size=16, metres=60)
    with pytest.raises(InvalidValueError, match="metres must be those of the cells of messages, 96, got 60"):
        BevImage(Speaking(make("action(form=cells)")), size=16, metres=60)


def test_unfit_environments_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="env must have agents that say what they send"):
        Speaking(coopsim.parallel_env("crossing", **SMALL))
    with pytest.raises(InvalidValueError, match="messages of a fixed shape"):
        Speaking(make("action(form=payload)"))
    with pytest.raises(InvalidValueError, match="no messages in its actions"):
        FixedTracks(make())


SHAPES = [
    lambda uplink: Flatten(FixedSize(Speaking(make(uplink)), detections=8, messages=2, received=4)),
    lambda uplink: BevImage(Speaking(make(uplink)), size=16),
]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("uplink", ["action", "action(form=cells, cells=4, to=True, ask=True)"])
def test_pettingzoo_accepts_the_shapes(shape: Any, uplink: str) -> None:
    parallel_api_test(shape(uplink), 12)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasium_accepts_the_shapes() -> None:
    env = coopsim.single_env("crossing", tracker="late_fusion", others="late_fusion", uplink="action", **SMALL)
    check_env(FixedSize(env, detections=8, messages=2, received=4), skip_render_check=True)


@pytest.mark.filterwarnings("ignore")
def test_supersuit_makes_agents_the_environments_of_a_vector() -> None:
    supersuit = pytest.importorskip("supersuit")
    env = supersuit.pettingzoo_env_to_vec_env_v1(SHAPES[0]("action"))
    env.reset()
    observations, rewards, *_ = env.step(np.ones((env.num_envs, 8), np.float32))
    assert len(observations) == len(rewards) == env.num_envs


def test_a_vector_takes_them() -> None:
    made = coopsim.vector(
        "crossing", 2, workers=0, uplink="action", wrap=[Speaking, lambda env: FixedSize(env, detections=4)], **SMALL
    )
    made.reset(seed=3)
    action = dict.fromkeys(made.possible_agents, np.ones(4, np.float32))
    made.step([action, action])
    made.close()
