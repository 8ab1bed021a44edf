"""Whatever the channel is set to, no message is made, forgotten, or counted twice; and nobody's luck is another's."""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.channel import Channel, ChannelConfig
from coopsim.comms.channel.channel_config import AgentClock, LinkConfig
from coopsim.comms.channel.latency import EmpiricalLatency, GammaLatency, GaussianLatency, LogNormalLatency
from coopsim.comms.channel.loss import BernoulliLoss, GilbertElliottLoss
from coopsim.comms.radio.radio_config import Radio
from coopsim.types import Message, PoseEstimate

AGENTS = ("a", "b", "c")

latencies = st.one_of(
    st.builds(GaussianLatency, st.floats(0, 0.5), st.floats(0, 0.3)),
    st.builds(LogNormalLatency, st.floats(1e-3, 0.5), st.floats(0, 0.3)),
    st.builds(GammaLatency, st.floats(1e-3, 0.5), st.floats(0, 0.3)),
    st.builds(EmpiricalLatency, st.tuples(st.floats(0, 0.5), st.floats(0, 0.5))),
)
losses = st.one_of(
    st.builds(BernoulliLoss, st.floats(0, 1)),
    st.builds(GilbertElliottLoss, st.floats(0, 1), st.floats(0.01, 1), st.floats(0, 1), st.floats(0, 1)),
)
bandwidths = st.builds(
    Bandwidth,
    st.sampled_from([2e3, 8e3, 2e4, 4e4, 1e6]),  # a message is 1000 bits: from hopeless to ample
    st.sampled_from(["shared", "link"]),
    st.sampled_from(["in_order", "newest_first"]),
    st.one_of(st.just(np.inf), st.floats(0, 0.5)),
)
clocks = st.builds(
    AgentClock,
    st.one_of(st.none(), st.floats(0.5, 30)),
    st.floats(0, 0.3),
    st.floats(-1, 1),
    offset_noise_s=st.floats(0, 9),
)
radios = st.builds(
    Radio,
    st.sampled_from(["urban", "highway"]),
    power_dbm=st.floats(-60, 23),
    mcs=st.sampled_from([4, 7, 11]),
    block_bytes=st.integers(10, 350),
)
links = st.builds(LinkConfig, st.one_of(st.none(), latencies), st.one_of(st.none(), losses), st.booleans())
configs = st.builds(
    ChannelConfig,
    latency=latencies,
    loss=losses,
    range_m=st.floats(0, 300),
    processing_s=st.one_of(st.floats(0, 0.2), st.dictionaries(st.sampled_from(AGENTS), st.floats(0, 0.5))),
    bandwidth=st.one_of(st.none(), bandwidths),
    radio=st.one_of(st.none(), radios),
    duplication=st.floats(0, 1),
    bit_error_rate=st.one_of(st.just(0.0), st.floats(0, 0.01)),
    clocks=st.one_of(clocks, st.dictionaries(st.sampled_from(AGENTS), clocks)),
    links=st.dictionaries(st.sampled_from(["a > b", "a > *", "* > c", "* > *", "b > *"]), links, max_size=3),
)


def say(sender: str, now_ns: int) -> Message:
    return Message(sender, now_ns, PoseEstimate(np.zeros(4)), b"x" * 60, "detections")


def walk(config: ChannelConfig, seed: int, steps: int, agents: tuple[str, ...] = AGENTS) -> tuple[Channel, list[Any]]:
    """A random walk of agents that all speak in frames of random lengths, with the books checked in each."""
    channel, rng = Channel(config, seed), np.random.default_rng(seed)
    now_ns, heard, log = 0, Counter(), []  # type: ignore[var-annotated]
    for _ in range(steps):
        now_ns += int(rng.integers(1, 2e8))
        places = rng.uniform(-200, 200, (len(AGENTS) + 1, 3))  # as many draws for any number of agents
        positions = dict(zip([*AGENTS, "d"], places, strict=True))
        positions = {name: positions[name] for name in agents}
        channel.send([say(sender, now_ns) for sender in agents], now_ns, positions)
        for receiver, inbox in channel.deliver(now_ns).items():
            heard.update((message.sender, receiver) for message in inbox)
            log += [(now_ns, receiver, message.sender, message.captured_ns) for message in inbox]
        for link, counts in channel.link_counts.items():
            assert counts.sent == counts.delivered + counts.lost + counts.pending
            assert heard[link] == counts.delivered + counts.duplicates
            assert counts.corrupted + counts.stale <= counts.lost and counts.duplicates <= counts.sent
        total = channel.counts
        assert total.sent == total.delivered + total.lost + total.pending
    return channel, log


def in_slots(config: ChannelConfig, slots: int) -> ChannelConfig:
    """The same with messages that disturb each other."""
    return replace(config, radio=replace(config.radio or Radio(), slots=slots), bandwidth=None)


@settings(max_examples=150)
@given(
    config=st.one_of(configs, st.builds(in_slots, configs, st.integers(1, 20))),
    seed=st.integers(0, 1000),
    steps=st.integers(1, 20),
)
def test_messages_are_conserved_on_every_link_at_every_step(config: ChannelConfig, seed: int, steps: int) -> None:
    channel, _ = walk(config, seed, steps)
    channel.deliver(10**17)
    assert channel.counts.pending == 0


def test_the_walk_meets_every_way_to_end() -> None:
    """Or the law above would hold for want of cases."""
    bandwidth = Bandwidth(2e4, max_wait_s=0.1)
    config = ChannelConfig(
        GaussianLatency(0.3, 0.2), BernoulliLoss(0.1), bandwidth=bandwidth, duplication=0.3, bit_error_rate=2e-4
    )
    channel, _ = walk(config, 0, 40)
    counts = channel.counts
    assert min(counts.delivered, counts.pending, counts.corrupted, counts.stale, counts.duplicates) > 0
    assert counts.lost > counts.corrupted + counts.stale


@settings(max_examples=40)
@given(config=configs, seed=st.integers(0, 1000))
def test_the_same_seed_gives_the_same_messages(config: ChannelConfig, seed: int) -> None:
    assert walk(config, seed, 8)[1] == walk(config, seed, 8)[1]


@settings(max_examples=40)
@given(config=configs.filter(lambda config: config.bandwidth is None), seed=st.integers(0, 1000))
def test_an_agent_more_changes_nothing_between_the_others(config: ChannelConfig, seed: int) -> None:
    """Where they do not share a medium, of course."""
    few, many = walk(config, seed, 8)[1], walk(config, seed, 8, (*AGENTS, "d"))[1]
    assert sorted(few) == sorted(entry for entry in many if "d" not in entry)


@pytest.mark.parametrize("loss", [0.2, 0.7])
def test_more_loss_and_more_delay_lose_and_delay_the_same_messages(loss: float) -> None:
    _, ideal = walk(ChannelConfig(), 1, 40)
    _, lossy = walk(ChannelConfig(loss=BernoulliLoss(loss)), 1, 40)
    _, lossier = walk(ChannelConfig(loss=BernoulliLoss(loss + 0.1)), 1, 40)
    assert set(lossier) < set(lossy) < set(ideal)
