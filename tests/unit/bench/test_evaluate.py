"""Running policies to a score: wiring, counting and pooling."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_env import SMALL

import coopsim
from coopsim.comms.channel import channel
from coopsim.envs.parallel import CooperativeEnv
from coopsim.errors import InvalidValueError, PolicyMismatchError, UnknownNameError
from coopsim.types import Observation, Tracks

DT_S = 0.1
SHORT: dict[str, Any] = SMALL | {"max_cycles": 4}


class Echo(coopsim.Policy):
    """Reports what it detects, one track for all, and remembers what was broadcast."""

    needs = coopsim.Needs(uplink="none")

    def reset(self, agent_specs: Any, seed: int = 0) -> None:
        super().reset(agent_specs, seed)
        self.heard = {spec.uplink for spec in agent_specs.values()}

    def track(self, agent: str, observation: Observation) -> Tracks:
        found = observation.detections
        return Tracks(np.arange(len(found)), found.boxes, np.zeros((len(found), 2)), found.score, found.label)


class Talker(Echo):
    needs = coopsim.Needs()


class Counting(Echo):
    def track(self, agent: str, observation: Observation) -> Tracks:
        self.counts["frames of an agent"] += 1
        return super().track(agent, observation)


class FirstSequenceOnly(Echo):
    """Reports nothing in any episode but its first, where it also reports a ghost."""

    episodes = 0

    def reset(self, agent_specs: Any, seed: int = 0) -> None:
        super().reset(agent_specs, seed)
        self.episodes += 1

    def track(self, agent: str, observation: Observation) -> Tracks:
        seen = super().track(agent, observation)
        if self.episodes > 1:
            return Tracks.empty()
        box = type(seen.boxes).from_array([*seen.boxes.array, [50, 20, 0, 4, 2, 1.5, 0]])
        count = len(box)
        return Tracks(np.arange(count), box, np.zeros((count, 2)), np.ones(count), np.zeros(count, dtype=int))


def test_what_a_policy_counts_is_of_one_episode() -> None:
    policy = Counting()
    for _ in range(2):
        found = coopsim.evaluate(policy, **SHORT)
        assert found.counts == {"frames of an agent": found.frames * len(found.score.agents)}
    assert coopsim.evaluate(Echo(), **SHORT).counts == {}


@pytest.fixture
def on_air(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Bytes by sender, counted where messages are encoded."""
    counted: Counter[str] = Counter()
    encode = channel.encode_message

    def count(message: Any) -> bytes:
        wire = encode(message)
        counted[message.sender] += len(wire)
        return wire

    monkeypatch.setattr(channel, "encode_message", count)
    return counted


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> list[CooperativeEnv]:
    """Environments that were closed."""
    seen: list[CooperativeEnv] = []
    monkeypatch.setattr(CooperativeEnv, "close", lambda env: seen.append(env))
    return seen


def test_same_seed_same_score_whoever_makes_the_policy() -> None:
    first = coopsim.evaluate("late_fusion", seed=3, loss=0.2, **SHORT)
    again = coopsim.evaluate(coopsim.make_policy("late_fusion"), "crossing-v3", seed=3, loss=0.2, **SHORT)
    other = coopsim.evaluate("late_fusion", seed=4, loss=0.2, **SHORT)
    assert first.score.to_dict() == again.score.to_dict() != other.score.to_dict()
    np.testing.assert_array_equal(first.rewards, again.rewards)
    assert first.frames == len(first.rewards) == SHORT["max_cycles"]
    assert first.frames_per_s == first.frames / first.seconds > 0


@pytest.mark.parametrize("policy", [Echo(), Talker()], ids=lambda policy: policy.needs.uplink)
def test_agents_broadcast_what_the_policy_needs_and_the_bytes_are_counted(policy: Echo, on_air: Counter[str]) -> None:
    result = coopsim.evaluate(policy, **SHORT)
    assert policy.heard == {policy.needs.uplink}
    duration_s = (result.frames + 1) * DT_S  # the observation after the last step was sent for, too
    for agent, score in result.score.agents.items():
        assert score["bytes_per_s"] == pytest.approx(on_air[agent] / duration_s)
    assert result.score["bytes_per_s"] == pytest.approx(on_air.total() / len(result.score.agents) / duration_s)
    assert (on_air.total() > 0) == (policy.needs.uplink != "none")


def test_what_became_of_the_messages() -> None:
    result = coopsim.evaluate(Talker(), loss=0.3, latency_s=0.2, seed=1, **SHORT)
    messages, agents = result.messages, len(result.score.agents)
    assert messages.sent == (result.frames + 1) * agents * (agents - 1)
    assert messages.sent == messages.delivered + messages.lost + messages.pending
    assert min(messages.delivered, messages.lost, messages.pending) > 0
    assert messages.pending <= 2 * agents * (agents - 1)  # at most those of the last two frames
    ideal, silent = (coopsim.evaluate(policy, **SHORT).messages for policy in (Talker(), Echo()))
    assert ideal.delivered == ideal.sent == messages.sent and silent.sent == 0


def test_on_frame_watches_every_step(closed: list[CooperativeEnv]) -> None:
    times: list[int] = []
    with pytest.warns(DeprecationWarning, match="on_frame will go: give recorders"):
        coopsim.evaluate(Echo(), on_frame=lambda env: times.append(env.time_ns), **SHORT)
    assert times == [100_000_000, 200_000_000, 300_000_000, 400_000_000]
    assert len(closed) == 1


def test_recorders_are_told_of_every_sequence(recordings: Path) -> None:
    class Counter(coopsim.Recorder):
        steps = 0

        def on_step(self, episode: coopsim.Episode) -> None:
            self.steps += 1

    counted = Counter()
    assert coopsim.evaluate_recordings(Echo(), recordings, ("ego",), recorders=[counted]).frames == counted.steps == 10


def test_recordings_are_pooled_not_averaged(recordings: Path) -> None:
    result = coopsim.evaluate_recordings(FirstSequenceOnly(), recordings, ("ego",))
    assert result.frames == 10 and result.seconds > 0
    for protocol, ghosts in ((result.count, 6), (result.ignore, 0)):
        plain = protocol.all_tracks
        assert (plain["GT"], plain["TP"], plain["FN"], plain["FP"]) == (10, 6, 4, ghosts)
        assert plain["MOTA"] == pytest.approx(10 * (6 - ghosts))
    assert (result.count.false_positives, result.ignore.false_positives) == ("count", "ignore")


def test_bytes_of_recordings_are_pooled_over_all_their_time(recordings: Path, on_air: Counter[str]) -> None:
    result = coopsim.evaluate_recordings(Talker(), recordings, ("ego", "1"))
    duration_s = (6 + 1 + 4 + 1) * DT_S
    for agent in ("ego", "1"):
        assert result.count.agents[agent]["bytes_per_s"] == pytest.approx(on_air[agent] / duration_s)


def test_the_seed_decides_what_recorded_agents_lose(recordings: Path) -> None:
    def lossy(seed: int) -> Any:
        result = coopsim.evaluate_recordings("late_fusion", recordings, ("ego", "1"), seed=seed, latency_jitter_s=0.5)
        return result.count.to_dict()

    assert lossy(1) == lossy(1)
    assert any(lossy(1) != lossy(seed) for seed in range(2, 6))


@pytest.mark.parametrize(
    ("policy", "options", "error", "match"),
    [
        ("late_fusoin", {}, UnknownNameError, "unknown policy 'late_fusoin'. Did you mean 'late_fusion'"),
        (Echo, {}, InvalidValueError, r"got the class Echo: write Echo\(\)"),
        (None, {}, InvalidValueError, "must be a coopsim.Policy or the name of one, got None"),
        (Echo(), {"uplink": "none"}, InvalidValueError, "uplink is not an option here: Echo decides it.*'none'"),
        (Echo(), {"latency": 1}, UnknownNameError, "unknown option 'latency'. Did you mean"),
    ],
)
def test_bad_input(recordings: Path, policy: Any, options: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.evaluate(policy, **options)
    with pytest.raises(error, match=match):
        coopsim.evaluate_recordings(policy, recordings, ("ego",), **options)


def test_unknown_environments_suggest() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'highway-v3'"):
        coopsim.evaluate(Echo(), "higway")


def test_environments_are_closed_when_the_policy_fails(recordings: Path, closed: list[CooperativeEnv]) -> None:
    class Broken(Echo):
        def track(self, agent: str, observation: Observation) -> Tracks:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        coopsim.evaluate(Broken(), **SHORT)
    with pytest.raises(ZeroDivisionError):
        coopsim.evaluate_recordings(Broken(), recordings, ("ego",))
    assert len(closed) == 2


class Sweeping(Echo):
    """Needs sweeps."""

    needs = coopsim.Needs(uplink="none", lidar=True)


@pytest.mark.parametrize("defense", ["cad", "mate"])
def test_a_defence_that_needs_a_lidar_is_named(defense: str) -> None:
    who = f"the defense {defense!r} of LateFusion needs a LiDAR, but cav_0 has none"
    with pytest.raises(PolicyMismatchError, match=who):
        coopsim.evaluate(f"late_fusion(defense={defense})", "crossing", lidar=None, max_cycles=2)


@pytest.mark.parametrize("lidar", [None, "VLP-16"])
def test_a_policy_that_needs_a_lidar_is_given_one_or_refused_at_once(lidar: str | None) -> None:
    options = SHORT | {"lidar": lidar}
    if lidar is not None:
        assert coopsim.evaluate(Sweeping(), **options).frames == 4
        return
    with pytest.raises(PolicyMismatchError, match=r"Sweeping needs a LiDAR, but \w+ has none.*lidar=None"):
        coopsim.evaluate(Sweeping(), **options)
    env = coopsim.parallel_env("crossing", **options)
    with pytest.raises(PolicyMismatchError, match="Sweeping needs a LiDAR"):
        Sweeping().reset(env.agent_specs)


def test_a_replay_has_no_lidar(recordings: Path) -> None:
    with pytest.raises(PolicyMismatchError, match=r"Sweeping needs a LiDAR, but ego has none.*in a replay"):
        coopsim.evaluate_recordings(Sweeping(), recordings, ("ego",))


@pytest.mark.parametrize(
    ("needs", "error", "match"),
    [
        ({"uplink": 3}, InvalidValueError, "uplink must be the name of a content, got 3"),
        ({"lidar": "yes"}, InvalidValueError, "lidar must be True or False, got 'yes'"),
        ({"cameras": "frnt"}, UnknownNameError, "unknown cameras 'frnt'. Did you mean 'front'"),
    ],
)
def test_needs_that_nothing_can_meet_are_refused(needs: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.Needs(**needs)
