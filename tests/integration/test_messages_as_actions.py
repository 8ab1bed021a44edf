"""Agents whose actions say what they send: the environment takes it, checks it and delivers it one frame later."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny_recordings
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test
from small_env import SMALL

import coopsim
from coopsim.agents.boxes import LateFusion
from coopsim.comms.codecs.codec import decoder
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.by_action import SaidByAction
from coopsim.errors import InvalidActionError, InvalidValueError, UnknownNameError
from coopsim.types import AgentSpec, Detections, Observation, Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.wire.observation_format import ObservationFormat

SHORT: dict[str, Any] = SMALL | {"max_cycles": 6, "lidar": None, "vehicles": 30}
NOTHING = {"tracks": pack_tracks(Tracks.empty())}
ENVELOPE = 70


def make(uplink: Any = "action", **options: Any) -> Any:
    env = coopsim.parallel_env("crossing", uplink=uplink, **(SHORT | options))
    env.observations, _ = env.reset(seed=3)
    return env


def step(env: Any, message: Mapping[str, Any] | None = None, **messages: Any) -> dict[str, Observation]:
    """Step with one message for all agents, or with some of their own."""
    observations, *_ = env.step({name: NOTHING | {"message": messages.get(name, message)} for name in env.agents})
    return dict(ObservationFormat.to_unpack(env.agent_specs).unpack_all(observations))


def scores(*values: float, most: int = 64) -> dict[str, Any]:
    return {"score": np.pad(np.float32(values), (0, most - len(values)))}


def found(env: Any, agent: str) -> np.ndarray:
    return np.asarray(env.observations[agent]["detections"]["box"])


def received(observation: Observation) -> dict[str, Detections]:
    return {message.sender: decode_detections(message) for message in observation.inbox}


def test_the_detections_that_a_score_chooses_arrive_in_the_next_frame() -> None:
    env = make()
    sender, receiver = env.agents[:2]
    assert len(found(env, sender)) > 2
    seen = step(env, None, **{sender: scores(0.2, 0.0, 0.9)})[receiver]
    (message,) = seen.inbox
    assert message.sender == sender and message.captured_ns == 0 < seen.time_ns
    np.testing.assert_allclose(decode_detections(message).boxes.array, found(env, sender)[[2, 0]], rtol=1e-6, atol=1e-6)


def test_a_delay_counts_from_the_observation() -> None:
    env = make(latency_s=0.15)
    arrived = [[len(each.inbox) for each in step(env, scores(1.0)).values()] for _ in range(3)]
    others = len(env.agents) - 1
    assert arrived == [[0] * (others + 1), [others] * (others + 1), [others] * (others + 1)]


def test_nothing_said_costs_nothing() -> None:
    for uplink in ("action", "action(threshold=0.5)"):
        env = make(uplink)
        for message in (None, scores(), scores(0.4) if "threshold" in uplink else None):
            assert not any(each.inbox for each in step(env, message).values())
        assert env.channel_counts.sent == 0 and env.bytes_per_s(env.agents[0]) == 0


def test_a_budget_cuts_the_lowest_scores() -> None:
    whole, cut = make(), make(budget_bytes=150)
    sender, receiver = whole.agents[:2]
    count = len(found(whole, sender))
    rising = scores(*np.linspace(0.1, 1.0, count))
    everything = received(step(whole, rising)[receiver])[sender]
    kept = received(step(cut, rising)[receiver])[sender]
    assert 0 < len(kept) < len(everything) == count
    np.testing.assert_array_equal(kept.boxes.array, everything.boxes.array[: len(kept)])
    assert cut.bytes_per_s(sender) * (cut.time_ns / 1e9 + 0.1) <= 150


def test_a_budget_for_no_detection_is_silence() -> None:
    env = make(budget_bytes=ENVELOPE)
    step(env, scores(1.0))
    assert env.channel_counts.sent == 0


def test_cells_score_the_detections_in_them() -> None:
    env = make("action(form=cells, cells=2, metres=400)")
    sender, receiver = env.agents[:2]
    boxes = found(env, sender)
    ahead_left = (boxes[:, 0] > 0) & (boxes[:, 1] > 0)
    sent = received(step(env, None, **{sender: {"score": np.float32([[1, 0], [0, 0]])}})[receiver])
    assert len(sent.get(sender, ())) == np.count_nonzero(ahead_left)


def test_a_payload_is_sent_as_it_is() -> None:
    env = make("action(form=payload, codec=compact)")
    sender, receiver = env.agents[:2]
    box = found(env, sender)[:1]
    payload = decoder("compact").encode(Detections(boxes_of(box), [0.5], [0]))
    for given in (payload, np.frombuffer(payload, np.uint8), np.frombuffer(payload, np.uint8)[:, None]):
        (message,) = step(env, None, **{sender: {"payload": given}})[receiver].inbox
        assert message.payload == payload and message.codec == "compact"
    assert not any(each.inbox for each in step(env, {"payload": b""}).values())


def boxes_of(rows: np.ndarray) -> Any:
    return coopsim.geometry.boxes.Boxes3D.from_array(rows)


def test_a_message_may_be_for_some() -> None:
    env = make("action(to=True)")
    sender, receiver, other = env.agents[:3]
    to = np.array([name == receiver for name in env.possible_agents])
    seen = step(env, scores() | {"to": to}, **{sender: scores(1.0) | {"to": to}})
    assert [len(seen[name].inbox) for name in (sender, receiver, other)] == [0, 1, 0]
    assert env.channel_counts.sent == env.channel_counts.delivered == 1


def test_only_those_who_asked_are_answered_in_the_next_step() -> None:
    env = make("action(ask=True)")
    asking, asked = env.agents[:2]
    nobody = np.zeros(len(env.possible_agents), np.int8)
    wish = np.array([name == asked for name in env.possible_agents])
    says = scores(1.0) | {"ask": nobody}
    first = step(env, says, **{asking: says | {"ask": wish}})
    assert not any(each.inbox for each in first.values())
    second = step(env, says)
    assert {name: [m.sender for m in each.inbox] for name, each in second.items() if each.inbox} == {asking: [asked]}
    assert not any(each.inbox for each in step(env, says).values())


PAYLOAD = "action(form=payload)"

WRONG: list[tuple[str, dict[str, Any], Any, str]] = [
    ("action", {}, {}, r"message must be None or a dict with \['score'\], got \[\]"),
    ("action", {}, 3, r"got 3"),
    ("action", {}, {"score": np.zeros(5)}, r"score must have shape \(64,\), got \(5,\)"),
    ("action", {}, {"score": np.full(64, np.nan)}, "score must be finite"),
    ("action", {}, {"score": np.full(64, 2.0)}, r"score must be in \[0, 1\], got 2 to 2"),
    ("action", {}, {"score": ["much"] * 64}, "score must be numbers"),
    ("action(form=cells)", {}, {"score": np.zeros(64)}, r"shape \(16, 16\), got \(64,\)"),
    ("action(to=True)", {}, scores(1.0), r"dict with \['score', 'to'\], got \['score'\]"),
    ("action(to=True)", {}, scores(1.0) | {"to": [1]}, "message to must be a 0 or 1 for each of cav_0"),
    ("action(ask=True)", {}, scores(1.0) | {"ask": "cav_1"}, "message ask must be a 0 or 1 for each"),
    (PAYLOAD, {}, {"payload": b"\x07nonsense"}, "message payload must be one of codec 'detections'"),
    (PAYLOAD, {}, {"payload": [300]}, r"numbers in 0..255, got 300 to 300"),
    (PAYLOAD, {}, {"payload": np.zeros((2, 2), np.int64)}, r"\(B,\) or \(B, 1\), got \(2, 2\)"),
    (PAYLOAD, {"budget_bytes": 99}, {"payload": bytes(99)}, "at most 99 bytes, envelope included, got"),
]


@pytest.mark.parametrize(("uplink", "options", "message", "error"), WRONG)
def test_what_is_wrong_is_named_and_changes_nothing(
    uplink: str, options: dict[str, Any], message: Any, error: str
) -> None:
    env, twin = make(uplink, **options), make(uplink, **options)
    last = env.agents[-1]
    with pytest.raises(InvalidActionError, match=f"{last}.*{error}"):
        step(env, None, **{last: message})
    observations = [step(each, None) for each in (env, twin)]
    for name in twin.agents:
        one, other = (each[name] for each in observations)
        assert one.time_ns == other.time_ns and len(one.inbox) == len(other.inbox)
        np.testing.assert_array_equal(one.detections.boxes.array, other.detections.boxes.array)
    assert env.channel_counts == twin.channel_counts


def test_a_missing_message_is_named() -> None:
    env = make()
    with pytest.raises(InvalidActionError, match=r"an action is a dict with 'message', which may be None, got"):
        env.step(dict.fromkeys(env.agents, NOTHING))
    assert env.time_ns == 0


@pytest.mark.parametrize(
    ("spec", "kind", "match"),
    [
        ("action(form=boxes)", UnknownNameError, "unknown form 'boxes'"),
        ("action(threshold=2)", InvalidValueError, "threshold must be"),
        ("action(rows=0)", InvalidValueError, "rows must be"),
        ("action(metres=-1)", InvalidValueError, "metres must be"),
        ("action(to=3)", InvalidValueError, "to must be"),
        ("action(codec=points)", UnknownNameError, "unknown codec 'points'"),
    ],
)
def test_a_wrong_option_is_refused(spec: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        coopsim.parallel_env("crossing", uplink=spec, **SHORT)


def test_any_policy_tracks_and_speaks() -> None:
    env = make(budget_bytes=400)
    policy = coopsim.make_policy("late_fusion")
    observations = env.observations
    policy.reset(env.agent_specs, seed=3)
    while env.agents:
        observations, *_ = env.step(policy.act(observations))
    counts = env.channel_counts
    assert counts.sent == counts.delivered > 0


@pytest.mark.filterwarnings("ignore:reset option 'options'")
def test_a_recording_takes_messages(tmp_path: Path) -> None:
    folder = tiny_recordings.write_opv2v(tmp_path)
    env = coopsim.parallel_env("replay", path=folder, detector="simulated", uplink="action")
    env.observations, _ = env.reset(seed=0)
    sender, receiver = env.agents
    seen = step(env, None, **{sender: scores(1.0)})[receiver]
    assert [message.sender for message in seen.inbox] == [sender] * (len(found(env, sender)) > 0)
    parallel_api_test(coopsim.parallel_env("replay", path=folder, detector="simulated", uplink="action"), 4)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("uplink", ["action", "action(form=cells, to=True)", "action(form=payload, ask=True)"])
def test_pettingzoo_and_gymnasium_accept_it(uplink: str) -> None:
    parallel_api_test(coopsim.parallel_env("crossing", uplink=uplink, **SHORT), 12)
    check_env(
        coopsim.single_env("crossing", tracker="late_fusion", others="late_fusion", uplink=uplink, **SHORT),
        skip_render_check=True,
    )


def test_with_a_tracker_the_message_alone_is_the_action() -> None:
    env = coopsim.single_env("crossing", tracker="late_fusion", others="late_fusion", uplink="action", **SHORT)
    assert set(env.action_space.spaces) == {"score"}
    env.reset(seed=3)
    observation, *_ = env.step(None)
    assert len(observation["inbox"]["sender"]) == len(env.parallel.possible_agents) - 1
    both = coopsim.single_env("crossing", tracker="late_fusion", uplink="action", control="policy", **SHORT)
    assert set(both.action_space.spaces) == {"maneuver", "message"}
    both.reset(seed=3)
    both.step({"maneuver": 1, "message": None})
    with pytest.raises(InvalidActionError, match=r"an action is a dict with \['maneuver', 'message'\], got \[\]"):
        both.step({})


def test_a_vector_takes_messages() -> None:
    roles = {"agents": "single", "tracker": "late_fusion", "others": "late_fusion"}
    made = coopsim.vector("crossing", 2, workers=0, uplink="action", **roles, **SHORT)
    made.reset(seed=3)
    _, rewards, *_ = made.step({"score": np.ones((2, 64), np.float32)})
    assert rewards.shape == (2,)
    made.close()


class Brief(LateFusion):
    """Says its surest detection only."""

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> SaidByAction:
        return SaidByAction()

    def speak(self, agent: str, observation: Observation) -> dict[str, Any]:
        score = observation.detections.score
        return scores(*(score == score.max(initial=1e-9)).astype(float)[:64])


def test_a_policy_that_speaks_is_evaluated_as_any_other() -> None:
    brief = coopsim.evaluate(Brief(), "crossing", seed=3, **SHORT)
    whole = coopsim.evaluate("late_fusion", "crossing", seed=3, **SHORT)
    assert 0 < brief.score["bytes_per_s"] < whole.score["bytes_per_s"]
    assert brief.messages.delivered > 0


def test_attacks_are_refused_where_actions_may_lie() -> None:
    with pytest.raises(InvalidValueError, match=r"attacks cannot be combined with uplink=.action."):
        coopsim.parallel_env("crossing", uplink="action", attacks={"cav_1": "ghost"}, **SHORT)
