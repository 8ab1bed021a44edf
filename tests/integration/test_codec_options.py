"""The option `codec`: policies run with any codec for what they need, and what cannot be read is counted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_env import SMALL

import coopsim
from coopsim.comms.codecs.codec import codecs_of
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.types import Detections, Message, Observation

SHORT: dict[str, Any] = SMALL | {"max_cycles": 8, "lidar": None}


@pytest.mark.parametrize("policy", ["late_fusion", "coop_fuse"])
def test_a_policy_runs_with_every_codec_for_what_it_needs(policy: str) -> None:
    scores = {codec: coopsim.evaluate(policy, seed=3, codec=codec, **SHORT).score for codec in codecs_of("detections")}
    plain = coopsim.evaluate(policy, seed=3, **SHORT).score
    assert scores["detections"].values == plain.values
    for score in scores.values():
        assert score["TP"] == pytest.approx(plain["TP"], rel=0.1)
    rate = {codec: score["bytes_per_s"] for codec, score in scores.items()}
    assert rate["compact"] < 0.8 * rate["detections"]


def test_a_recording_is_replayed_with_every_codec(recordings: Path) -> None:
    assert codecs_of("detections")
    for codec in codecs_of("detections"):
        env = coopsim.parallel_env("replay", path=recordings, detections=("ego", "1"), codec=codec)
        assert {spec.codec for spec in env.agent_specs.values()} == {codec}
        result = coopsim.evaluate_recordings("late_fusion", recordings, ("ego", "1"), codec=codec)
        assert result.count["TP"] > 0


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"codec": "compakt"}, UnknownNameError, r"unknown codec 'compakt'\. Did you mean 'compact'"),
        ({"codec": "tracks"}, UnknownNameError, "Accepted: compact, cpm, detections"),
        ({"codec": 3}, UnknownNameError, "unknown codec 3"),
        ({"codec": "tracks", "uplink": "tracks"}, InvalidValueError, "codec must be None for uplink 'tracks'"),
        ({"codec": "cpm", "uplink": "none"}, InvalidValueError, "codec must be None for uplink 'none'.*got 'cpm'"),
    ],
)
def test_a_codec_that_does_not_fit_is_refused(options: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", **(SHORT | options))


class Wild(SimulatedDetector):
    """Detects, next to what is there, what no codec can carry."""

    def detect(self, *args: Any) -> Detections:
        found = super().detect(*args)
        rows = np.tile([10.0, 0, 0.8, 4.5, 1.9, 1.6, 0.0], (4, 1))
        rows[0, 0], rows[1, 3], rows[2, 6], rows[3, 1] = 1e300, -1.0, np.nan, np.inf
        wild = Detections(type(found.boxes).from_array(rows), np.full(4, 0.9), np.zeros(4, dtype=int))
        return Detections.concatenate([found, wild])


@pytest.mark.parametrize("codec", codecs_of("detections"))
def test_what_cannot_be_sent_is_left_out(codec: str) -> None:
    plain = coopsim.evaluate("late_fusion", seed=3, codec=codec, **SHORT)
    wild = coopsim.evaluate("late_fusion", seed=3, codec=codec, **(SHORT | {"detector": Wild()}))
    assert wild.score.values == plain.score.values
    assert wild.messages.rejected == 0


class Garbled(Uplink):
    """Every second message of another uplink is broken before it is sent, so that its checksum is right."""

    def __init__(self, uplink: Uplink) -> None:
        self.content, self._uplink = uplink.content, uplink  # type: ignore[misc]

    def message(self, sender: str, observation: Observation) -> Message | None:
        sent = self._uplink.message(sender, observation)
        if sent is None or observation.time_ns // 100_000_000 % 2:
            return sent
        return Message(sender, sent.captured_ns, sent.pose, sent.payload[:-1], sent.codec)


@pytest.mark.parametrize("policy", ["late_fusion", "track_to_track"])
def test_messages_that_cannot_be_read_are_counted_in_the_evaluation(
    monkeypatch: pytest.MonkeyPatch, policy: str
) -> None:
    made = coopsim.make_policy(policy)
    make_uplink = made.make_uplink
    monkeypatch.setattr(made, "make_uplink", lambda spec, rng: Garbled(make_uplink(spec, rng)))
    result = coopsim.evaluate(made, seed=3, **SHORT)
    frames = np.arange(0, 8)  # what the ninth observation brings is never acted on
    agents = len(made.specs)
    expected = int((frames % 2 == 0).sum()) * agents * (agents - 1)
    assert result.messages.rejected == expected > 0
    rejected: Mapping[tuple[str, str], int] = made.rejected
    assert len(rejected) == agents * (agents - 1) and set(rejected.values()) == {4}


def test_no_fusion_reads_nothing_and_rejects_nothing() -> None:
    assert coopsim.evaluate("no_fusion", seed=3, **SHORT).messages.rejected == 0
