"""The channel delivers on time, loses what it should, and forgets nothing."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.channel import Channel, ChannelConfig, ChannelCounts
from coopsim.comms.channel.channel_config import AgentClock, LinkConfig
from coopsim.comms.channel.latency import GaussianLatency
from coopsim.comms.channel.loss import BernoulliLoss
from coopsim.comms.envelope import decode_message, encode_message
from coopsim.comms.radio.radio_config import Radio
from coopsim.errors import CodecError, InvalidValueError
from coopsim.types import Message, PoseEstimate

FRAME_NS = 100_000_000
NEAR = {"a": np.zeros(3), "b": np.array([10.0, 0, 0]), "c": np.array([0, 100.0, 0])}


def message(sender: str, captured_ns: int) -> Message:
    return Message(sender, captured_ns, PoseEstimate(np.zeros(4)), b"x" * 10, "detections")


def run(config: ChannelConfig, frames: int, seed: int = 0, agents: dict[str, np.ndarray] = NEAR):  # type: ignore[no-untyped-def]
    """Everyone talks in every frame; (now, receiver, sender, captured) of every delivery."""
    channel, log = Channel(config, seed), []
    for k in range(frames):
        channel.send([message(sender, k * FRAME_NS) for sender in agents], k * FRAME_NS, agents)
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


def test_an_agent_alone_broadcasts_to_nobody() -> None:
    channel, _ = run(ChannelConfig(bandwidth=Bandwidth(1000.0)), 3, agents={"a": np.zeros(3)})
    assert channel.broadcast_bytes("a") == 3 * len(encode_message(message("a", 0)))
    assert channel.counts == ChannelCounts() and not channel.link_counts


def test_a_flipped_bit_is_found_and_counted_as_lost() -> None:
    channel, log = run(ChannelConfig(bit_error_rate=1e-3), 200)
    bits = 8 * len(encode_message(message("a", 0)))
    assert 1 - channel.counts.corrupted / 1200 == pytest.approx((1 - 1e-3) ** bits, abs=0.04)
    assert channel.counts.lost == channel.counts.corrupted == 1200 - len(log)


@given(bit=st.integers(0, 8 * len(encode_message(message("a", 123))) - 1))
def test_any_flipped_bit_is_refused(bit: int) -> None:
    wire = bytearray(encode_message(message("a", 123)))
    wire[bit // 8] ^= 1 << (bit % 8)
    with pytest.raises(CodecError):
        decode_message(bytes(wire))


def test_a_duplicate_is_the_same_message_at_another_time_and_counted_apart() -> None:
    channel, log = run(ChannelConfig(GaussianLatency(0.2, 0.1), duplication=0.25), 200)
    channel.deliver(10**15)
    counts = channel.counts
    assert counts.duplicates == pytest.approx(0.25 * 1200, rel=0.15)
    assert counts.sent == counts.delivered == 1200
    whole = Counter((receiver, sender, captured) for _, receiver, sender, captured in log)
    assert max(whole.values()) == 2


def test_messages_may_overtake_each_other() -> None:
    _, log = run(ChannelConfig(GaussianLatency(0.5, 0.3)), 50)
    captured = [k for _, receiver, sender, k in log if (receiver, sender) == ("a", "b")]
    assert captured != sorted(captured)


def test_processing_comes_before_the_medium() -> None:
    config = ChannelConfig(processing_s=0.15, bandwidth=Bandwidth(8e3, "link"))
    _, log = run(config, 6)
    assert {now - captured for now, _, _, captured in log} == {3}
    airtime_ns = config.bandwidth.airtime_ns(len(encode_message(message("a", 0))))
    first = Channel(config, 0)
    first.send([message("a", 0)], 0, NEAR)
    assert not first.deliver(150_000_000 + airtime_ns - 10) and len(first.deliver(150_000_000 + airtime_ns)) == 2


def test_a_shared_medium_is_slower_than_links_of_the_same_rate() -> None:
    shared, _ = run(ChannelConfig(bandwidth=Bandwidth(8e3, "shared")), 20)
    link, _ = run(ChannelConfig(bandwidth=Bandwidth(8e3, "link")), 20)
    assert shared.counts.delivered < link.counts.delivered and shared.counts.lost == 0


def test_a_full_medium_with_the_newest_first_delivers_fresher_messages() -> None:
    age = {}
    for order in ("in_order", "newest_first"):
        _, log = run(ChannelConfig(bandwidth=Bandwidth(4e3, "shared", order)), 60)  # type: ignore[arg-type]
        age[order] = np.mean([now - captured for now, _, _, captured in log])
    assert age["newest_first"] < age["in_order"]


def test_clocks_decide_who_speaks_and_what_is_stamped() -> None:
    clocks = {"b": AgentClock(5.0, phase_s=0.1, offset_s=0.2)}
    channel, log = run(ChannelConfig(clocks=clocks), 6)
    assert {(now, captured - now) for now, _, sender, captured in log if sender == "b"} == {(1, 2), (3, 2), (5, 2)}
    assert {now for now, _, sender, _ in log if sender == "a"} == set(range(6))
    assert channel.link_counts["b", "a"].sent == 3 and channel.link_counts["a", "b"].sent == 6


def test_every_agent_and_episode_has_its_own_clock_error() -> None:
    config = ChannelConfig(clocks=AgentClock(offset_s=1.0, offset_noise_s=0.1))
    stamps = {}
    for seed in range(3):
        channel = Channel(config, seed)
        channel.send([message(name, 0) for name in NEAR], 0, NEAR)
        inboxes = channel.deliver(0)
        stamps |= {(seed, each.sender): each.captured_ns for inbox in inboxes.values() for each in inbox}
    assert len(set(stamps.values())) == 9
    assert all(0.5e9 < stamp_ns < 1.5e9 for stamp_ns in stamps.values())


def test_a_link_has_what_names_both_ends_before_what_names_one() -> None:
    late = {
        f"{pair}": LinkConfig(GaussianLatency(frames / 10)) for frames, pair in enumerate(("a > b", "a>*", "* > b"), 1)
    }
    channel, log = run(ChannelConfig(GaussianLatency(0.4), links=late), 6)
    ages = {(sender, receiver): {now - captured} for now, receiver, sender, captured in log}
    assert ages == {
        ("a", "b"): {1}, ("a", "c"): {2}, ("c", "b"): {3}, ("b", "a"): {4}, ("b", "c"): {4}, ("c", "a"): {4},
    }  # fmt: skip
    assert channel.counts.sent == 36


def test_a_link_by_cable_needs_neither_range_nor_radio_nor_medium() -> None:
    cable = {"a > b": LinkConfig(GaussianLatency(0.0), BernoulliLoss(0.0), wired=True)}
    nothing = ChannelConfig(
        GaussianLatency(0.1),
        BernoulliLoss(0.1),
        range_m=0.0,
        bandwidth=Bandwidth(1.0),
        radio=Radio(power_dbm=-300.0),
        links=cable,
    )
    channel, log = run(nothing, 5)
    assert [(now, sender, captured) for now, _, sender, captured in log] == [(k, "a", k) for k in range(5)]
    assert channel.link_counts["a", "b"].delivered == 5 and channel.link_counts["b", "a"].lost == 5


def test_who_has_no_link_but_by_cable_takes_no_time_on_the_air() -> None:
    shared = Bandwidth(8e3, "shared", max_wait_s=0.05)
    alone = {"a > *": LinkConfig(wired=True), "b > *": LinkConfig(loss=BernoulliLoss(1.0), wired=True)}
    crowded, _ = run(ChannelConfig(bandwidth=shared), 20)
    wired, _ = run(ChannelConfig(bandwidth=shared, links=alone), 20)
    assert crowded.counts.stale > 0 == wired.counts.stale


def test_each_agent_may_have_its_own_processing_time_before_a_shared_medium() -> None:
    """Who is ready first is sent first, whatever the order of agents; the others wait their turn."""
    config = ChannelConfig(processing_s={"a": 0.3, "b": 0.1}, bandwidth=Bandwidth(1e6))
    channel, log = run(config, 8)
    assert {(sender, now - captured) for now, _, sender, captured in log} == {("a", 4), ("b", 2), ("c", 1)}
    assert channel.counts.pending == 2 * (4 + 2 + 1)


def test_radio_delivers_what_is_near_and_is_the_same_in_both_directions() -> None:
    places = {"a": np.zeros(3), "b": np.array([50.0, 0, 0]), "c": np.array([0, 200_000.0, 0])}
    channel, _ = run(ChannelConfig(radio=Radio()), 100, agents=places)
    assert channel.link_counts["a", "b"].delivered == channel.link_counts["b", "a"].delivered == 100
    assert channel.link_counts["a", "c"].delivered == channel.link_counts["c", "b"].delivered == 0
    # Where chances are neither 0 nor 1, shadowing decides for both directions alike.
    for seed in range(20):
        sharp = ChannelConfig(radio=Radio(power_dbm=-25.0, snr_half_db=5.0, snr_spread_db=1e-3))
        channel, _ = run(sharp, 5, seed, {"a": np.zeros(3), "b": np.array([200.0, 0, 0])})
        assert channel.link_counts["a", "b"] == channel.link_counts["b", "a"]


@settings(max_examples=40)
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
        (lambda: GaussianLatency(-0.1), r"mean_s must be in \[0, 3600\], got -0.1"),
        (lambda: GaussianLatency(0.1, float("nan")), "jitter_s"),
        (lambda: BernoulliLoss(1.5), r"probability must be in \[0, 1\], got 1.5"),
        (lambda: BernoulliLoss(float("nan")), "probability"),
        (lambda: ChannelConfig(range_m=-1), "range_m must be >= 0"),
        (lambda: ChannelConfig(processing_s=-1), r"processing_s must be in \[0, 3600\], got -1"),
        (lambda: ChannelConfig(duplication=2), "duplication must be in"),
        (lambda: ChannelConfig(bit_error_rate=0.6), r"bit_error_rate must be in \[0, 0.5\], got 0.6"),
        (lambda: ChannelConfig(latency=0.1), "latency must be a coopsim Latency or None, got 0.1"),
        (lambda: ChannelConfig(loss=None), "latency and loss must be models, got None"),
        (lambda: ChannelConfig(radio=Radio), r"radio must be a coopsim Radio or None.*write Radio\(\)"),
        (lambda: ChannelConfig(processing_s={"a": -1}), r"processing_s of a must be in \[0, 3600\], got -1"),
        (lambda: ChannelConfig(links={"a": LinkConfig()}), "a link in links is \"sender > receiver\".*got 'a'"),
        (lambda: ChannelConfig(links={"a > b": 5}), "links must be LinkConfigs.*got 5 for 'a > b'"),
        (lambda: ChannelConfig(links=[]), "links must be LinkConfigs.*got \\[\\]"),
        (lambda: ChannelConfig(links={"a > b": LinkConfig(), "a>b": LinkConfig()}), "links has 'a > b' twice"),
        (lambda: LinkConfig(latency=0.1), "latency must be a coopsim Latency or None, got 0.1"),
        (lambda: LinkConfig(wired=1), "wired must be True or False, got 1"),
        (lambda: ChannelConfig(radio=Radio(slots=9), bandwidth=Bandwidth(1e6)), "slots and bandwidth exclude each"),
        (lambda: ChannelConfig(clocks={"a": 5.0}), "clocks must be an AgentClock, or one by agent; got 5.0 for 'a'"),
    ],
)
def test_bad_settings(make, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidValueError, match=match):
        make()
