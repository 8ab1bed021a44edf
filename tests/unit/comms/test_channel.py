"""The channel delivers on time, loses what it should, and forgets nothing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.channel import Channel, ChannelConfig
from coopsim.comms.latency import GaussianLatency
from coopsim.comms.loss import BernoulliLoss
from coopsim.comms.message import encode_message
from coopsim.errors import InvalidValueError
from coopsim.types import Message, PoseEstimate

FRAME_NS = 100_000_000
NEAR = {"a": np.zeros(3), "b": np.array([10.0, 0, 0]), "c": np.array([0, 100.0, 0])}


def message(sender: str, captured_ns: int) -> Message:
    return Message(sender, captured_ns, PoseEstimate(np.zeros(4)), b"x" * 10, "detections")


def run(config: ChannelConfig, frames: int, seed: int = 0, agents: dict[str, np.ndarray] = NEAR):  # type: ignore[no-untyped-def]
    """Everyone talks in every frame; (now, receiver, sender, captured) of every delivery."""
    channel, log = Channel(config, seed), []
    for k in range(frames):
        for sender in agents:
            channel.send(message(sender, k * FRAME_NS), k * FRAME_NS, agents)
        for receiver, inbox in channel.deliver(k * FRAME_NS).items():
            log += [(k, receiver, item.sender, item.captured_ns // FRAME_NS) for item in inbox]
    return channel, log


def test_ideal_channel_delivers_in_the_same_frame() -> None:
    _, log = run(ChannelConfig(), 3)
    assert len(log) == 3 * 6
    assert all(now == captured and receiver != sender for now, receiver, sender, captured in log)


@pytest.mark.parametrize(("latency_s", "frames"), [(0.2, 2), (0.25, 3), (0.0999, 1), (0.1, 1), (0.10001, 2)])
def test_latency_is_a_time_not_a_number_of_frames(latency_s: float, frames: int) -> None:
    _, log = run(ChannelConfig(GaussianLatency(latency_s)), 8)
    assert {now - captured for now, _, _, captured in log} == {frames}


def test_range_is_per_link() -> None:
    _, log = run(ChannelConfig(range_m=50.0), 1)
    assert {(receiver, sender) for _, receiver, sender, _ in log} == {("a", "b"), ("b", "a")}


def test_loss_has_its_probability_and_more_loss_loses_the_same_and_more() -> None:
    arrived = {}
    for loss in (0.0, 0.3, 0.6, 1.0):
        _, log = run(ChannelConfig(loss=BernoulliLoss(loss)), 300)
        arrived[loss] = set(log)
    assert len(arrived[0.0]) == 1800
    assert len(arrived[0.3]) == pytest.approx(0.7 * 1800, rel=0.05)
    assert arrived[1.0] == set() and arrived[0.6] < arrived[0.3] < arrived[0.0]


def test_an_agent_more_changes_nothing_between_the_others() -> None:
    config = ChannelConfig(GaussianLatency(0.1, 0.08), BernoulliLoss(0.3))
    _, few = run(config, 50)
    _, many = run(config, 50, agents={**NEAR, "d": np.ones(3)})
    assert sorted(few) == sorted(entry for entry in many if "d" not in entry)


def test_bytes_are_those_of_the_encoded_message_once_per_broadcast() -> None:
    channel, _ = run(ChannelConfig(), 5)
    assert channel.broadcast_bytes("a") == 5 * len(encode_message(message("a", 0)))
    assert channel.broadcast_bytes("nobody") == 0


@settings(max_examples=40, deadline=None)
@given(
    latency_s=st.floats(0, 1),
    jitter_s=st.floats(0, 0.5),
    loss=st.floats(0, 1),
    range_m=st.floats(0, 150),
    frames=st.integers(1, 15),
)
def test_messages_are_conserved(latency_s: float, jitter_s: float, loss: float, range_m: float, frames: int) -> None:
    config = ChannelConfig(GaussianLatency(latency_s, jitter_s), BernoulliLoss(loss), range_m)
    channel, log = run(config, frames)
    counts = channel.counts
    assert counts.sent == 6 * frames == counts.delivered + counts.lost + counts.pending
    assert len(log) == counts.delivered
    channel.deliver(10**15)
    assert channel.counts.pending == 0 and channel.counts.sent == channel.counts.delivered + channel.counts.lost


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: GaussianLatency(-0.1), "latency_s must be a finite number >= 0, got -0.1"),
        (lambda: GaussianLatency(0.1, float("nan")), "latency_jitter_s"),
        (lambda: BernoulliLoss(1.5), r"loss must be in \[0, 1\], got 1.5"),
        (lambda: BernoulliLoss(float("nan")), "loss"),
        (lambda: ChannelConfig(range_m=-1), "communication_range_m must be >= 0"),
    ],
)
def test_bad_settings(make, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidValueError, match=match):
        make()
