"""Uplinks as objects: by a name with parameters, a factory or a policy; shared, batched and checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from small_env import SMALL

import coopsim
from coopsim.comms import envelope
from coopsim.comms.codecs.codec import CODECS
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.share_points import SharePoints
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import InvalidValueError, PolicyMismatchError, UnknownNameError
from coopsim.tracking.ab3dmot_tracker import OnBoardTracker
from coopsim.types import AgentSpec, Detections, Message, Observation

SHORT: dict[str, Any] = SMALL | {"max_cycles": 6}
Make = Callable[..., Any]


def run(env: Any, policy: coopsim.Policy, seed: int = 3) -> Any:
    observations, _ = env.reset(seed=seed)
    policy.reset(env.agent_specs, seed=seed)
    while env.agents:
        observations, *_ = env.step(policy.act(observations))
    return env.score()


def test_a_name_a_factory_and_a_policy_send_the_same() -> None:
    policy = coopsim.make_policy("late_fusion")
    scores = []
    for uplink in ("detections", "detections(codec=detections)", lambda spec, rng: ShareDetections(), policy):
        env = coopsim.parallel_env("crossing", uplink=uplink, **SHORT)
        assert {spec.uplink for spec in env.agent_specs.values()} == {"detections"}
        scores.append(run(env, policy).to_dict())
    assert scores[0] == scores[1] == scores[2] == scores[3]


class Shared(ShareDetections):
    """Serves all agents by one object, in one batch per frame."""

    def __init__(self) -> None:
        super().__init__("compact")
        self.batches: list[list[str]] = []
        self.began: list[str] = []
        self.heard: Counter[str] = Counter()

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self.began.append(spec.name)

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, Any]:
        self.batches.append(list(observations))
        return super().contents(observations)

    def hear(self, receiver: str, observation: Observation) -> None:
        self.heard[receiver] += len(observation.inbox)


@pytest.mark.parametrize("budget_bytes", [None, 10_000])
def test_one_object_serves_all_agents_in_one_batch_per_frame(budget_bytes: int | None) -> None:
    shared = Shared()
    env = coopsim.parallel_env("crossing", uplink=lambda spec, rng: shared, budget_bytes=budget_bytes, **SHORT)
    shared.began.clear()
    run(env, coopsim.make_policy("late_fusion"))
    agents = list(env.agent_specs)
    assert shared.began == agents and shared.batches == [agents] * 7
    assert shared.heard == dict.fromkeys(agents, 7 * (len(agents) - 1))


def test_agents_may_broadcast_different_contents() -> None:
    def by_kind(spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        return ShareDetections("compact" if spec.kind == "cav" else "detections")

    env = coopsim.parallel_env("crossing", uplink=by_kind, **SHORT)
    observations, _ = env.reset(seed=3)
    used = {
        (spec.kind, CODECS.names()[codec])
        for name in observations
        for sender, codec in zip(*(observations[name]["inbox"][key] for key in ("sender", "codec")), strict=True)
        for spec in [env.agent_specs[env.possible_agents[sender]]]
    }
    assert used == {("cav", "compact"), ("rsu", "detections")}
    assert all(env.observation_space(name).contains(each) for name, each in observations.items())
    mixed = coopsim.parallel_env(
        "crossing", uplink=lambda spec, rng: SharePoints() if spec.kind == "rsu" else ShareDetections(), **SHORT
    )
    with pytest.raises(PolicyMismatchError, match="needs uplink 'detections', but rsu_0 broadcasts 'points'"):
        coopsim.make_policy("late_fusion").reset(mixed.agent_specs)


def test_codecs_of_messages_stand_in_the_observation() -> None:
    """Nobody guesses: a receiver reads whatever codec a message names."""
    got: list[str] = []

    class Reader(coopsim.Policy):
        def track(self, agent: str, observation: Observation) -> Any:
            got.extend(message.codec for message in observation.inbox)
            found = self.read(agent, observation.inbox, envelope.decode_detections)
            assert len(found) == len(observation.inbox)
            return coopsim.types.Tracks.empty()

    run(coopsim.parallel_env("crossing", codec="compact", **SHORT), Reader())
    assert set(got) == {"compact"}


def test_track_to_track_tracks_once_per_agent_and_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: Counter[int] = Counter()
    step = OnBoardTracker.step

    def count(tracker: OnBoardTracker, observation: Observation) -> Any:
        steps[observation.time_ns] += 1
        return step(tracker, observation)

    monkeypatch.setattr(OnBoardTracker, "step", count)
    policy = coopsim.make_policy("track_to_track")
    for _ in range(2):  # the second episode begins anew
        steps.clear()
        result = coopsim.evaluate(policy, seed=3, **SHORT)
        agents = len(policy.specs)
        assert steps == {frame * 100_000_000: agents for frame in range(7)}
    assert result.score["bytes_per_s"] > 0


def test_track_to_track_scores_alike_with_an_uplink_of_its_own_and_by_name() -> None:
    by_name = run(coopsim.parallel_env("crossing", uplink="tracks", **SHORT), coopsim.make_policy("track_to_track"))
    policy = coopsim.make_policy("track_to_track")
    for _ in range(2):
        assert run(coopsim.parallel_env("crossing", uplink=policy, **SHORT), policy).to_dict() == by_name.to_dict()
    assert run(coopsim.parallel_env("crossing", uplink="tracks", **SHORT), policy).to_dict() == by_name.to_dict()


@pytest.mark.parametrize("channel", [{}, {"latency_s": 0.25, "latency_jitter_s": 0.1}, {"duplicates": 1.0}])
def test_a_broadcast_is_decoded_once_for_all_receivers(
    monkeypatch: pytest.MonkeyPatch, channel: dict[str, Any]
) -> None:
    decoded: Counter[tuple[str, int]] = Counter()
    decode = envelope.decode_detections

    def count(message: Message) -> Detections:
        decoded[message.sender, message.captured_ns] += 1
        return decode(message)

    monkeypatch.setattr("coopsim.agents.tracking_policy.decode_detections", count)
    options = {"channel": {"duplication": 1.0}} if channel.pop("duplicates", None) else channel
    result = coopsim.evaluate("late_fusion", seed=3, **(SHORT | {"max_cycles": 10}), **options)
    assert result.messages.delivered > 2 * len(decoded) > 0
    assert set(decoded.values()) == {1}


def test_the_environment_decodes_a_broadcast_once_for_all_receivers(monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: Counter[tuple[str, int]] = Counter()
    decode = envelope.decode_detections

    def count(message: Message) -> Detections:
        decoded[message.sender, message.captured_ns] += 1
        return decode(message)

    monkeypatch.setattr("coopsim.comms.uplinks.budget.decode_detections", count)
    env = coopsim.parallel_env("crossing", budget_bytes=200, selection="need", **SHORT)
    run(env, coopsim.make_policy("late_fusion"))
    agents = len(env.agent_specs)
    assert len(decoded) == 7 * agents and set(decoded.values()) == {1}


class Wrong(ShareDetections):
    def __init__(self, **changes: Any) -> None:
        super().__init__()
        self._changes = changes

    def message_with(self, sender: str, observation: Observation, payload: bytes) -> Any:
        fields = {"sender": sender, "codec": "detections"} | self._changes
        return Message(fields["sender"], observation.time_ns, observation.pose, payload, fields["codec"])


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"codec": "mine"}, r"Wrong must make messages of \w+ by a registered codec .*got one of \w+ by codec 'mine'"),
        ({"sender": "cav_9"}, "Wrong must make messages of .* got one of cav_9"),
    ],
)
def test_a_message_that_nobody_could_read_is_refused_where_it_is_sent(changes: dict[str, Any], match: str) -> None:
    env = coopsim.parallel_env("crossing", uplink=lambda spec, rng: Wrong(**changes), **SHORT)
    with pytest.raises(InvalidValueError, match=match):
        env.reset(seed=0)


@pytest.mark.parametrize("budget_bytes", [None, 500])
def test_content_of_a_wrong_class_is_refused_with_the_name_of_the_uplink(budget_bytes: int | None) -> None:
    class Rubbish(ShareDetections):
        def content_of(self, sender: str, observation: Observation) -> Any:
            return 5

    env = coopsim.parallel_env("crossing", uplink=lambda spec, rng: Rubbish(), budget_bytes=budget_bytes, **SHORT)
    match = "Rubbish must make content that codec 'detections' encodes, got int for cav_0"
    with pytest.raises(InvalidValueError, match=match):
        env.reset(seed=0)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"uplink": "points(kep=0.5)"}, UnknownNameError, "unknown parameter 'kep' of uplink 'points'.*'keep'"),
        ({"uplink": "points(keep=2)"}, InvalidValueError, r"keep must be in \(0, 1\], got 2"),
        (
            {"uplink": "points(codec=compact)"},
            UnknownNameError,
            "unknown codec 'compact' for points: it carries detections. Accepted: points, voxels",
        ),
        ({"uplink": "features"}, InvalidValueError, "uplink 'features' needs encode, which a name cannot give"),
        ({"uplink": ShareDetections}, InvalidValueError, "uplink must be an object, got the class ShareDetections"),
        ({"uplink": ShareDetections()}, InvalidValueError, "uplink must be .*: write lambda spec, rng: uplink"),
        ({"uplink": lambda spec, rng: None}, InvalidValueError, "uplink must make an Uplink for each agent, got None"),
        (
            {"uplink": lambda spec, rng: ShareDetections(), "codec": "compact"},
            InvalidValueError,
            "codec must be None for ShareDetections, which is made without regard to it, got 'compact'",
        ),
        (
            {"codec": "points(number=float16)"},
            UnknownNameError,
            "unknown codec 'points' for detections: it carries points. .*compact, cpm, detections",
        ),
        ({"uplink": "points", "codec": "points(number=int4)"}, UnknownNameError, "unknown number 'int4'"),
    ],
)
def test_what_cannot_be_an_uplink_is_refused_at_once(
    options: dict[str, Any], error: type[Exception], match: str
) -> None:
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", **(SHORT | options))


def test_a_factory_takes_the_codec_from_the_spec() -> None:
    env = coopsim.parallel_env(
        "crossing", uplink=lambda spec, rng: ShareDetections(spec.codec or "detections"), codec="compact", **SHORT
    )
    observations, _ = env.reset(seed=0)
    used = {codec for each in observations.values() for codec in each["inbox"]["codec"].tolist()}
    assert used == {CODECS.names().index("compact")}
