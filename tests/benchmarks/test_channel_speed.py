"""How fast the channel is: large messages, and many of them.

Run by `make bench`. Nothing here fails by time; the figures are printed.
"""

import time

import numpy as np
import pytest

from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.channel import Channel, ChannelConfig
from coopsim.comms.channel.latency import GammaLatency
from coopsim.comms.channel.loss import GilbertElliottLoss
from coopsim.comms.radio.radio_config import Radio
from coopsim.types import Message, PoseEstimate

FULL = ChannelConfig(
    latency=GammaLatency(0.1, 0.03),
    loss=GilbertElliottLoss(0.02, 0.3),
    bandwidth=Bandwidth(1e9, order="newest_first", max_wait_s=0.2),
    radio=Radio(),
    duplication=0.01,
    bit_error_rate=1e-8,
)


@pytest.mark.parametrize(("name", "config"), [("ideal", ChannelConfig()), ("everything on", FULL)])
@pytest.mark.parametrize(("agents", "frames"), [(2, 5000), (5, 500)])
def test_ten_thousand_messages_of_100_kb(name: str, config: ChannelConfig, agents: int, frames: int) -> None:
    channel, payload = Channel(config, 0), bytes(range(256)) * 391
    positions = {f"cav_{k}": np.array([20.0 * k, 0.0, 0.0]) for k in range(agents)}
    start, started = time.perf_counter(), time.process_time()
    for frame in range(frames):
        now_ns = frame * 10**8
        said = [Message(sender, now_ns, PoseEstimate(np.zeros(4)), payload, "detections") for sender in positions]
        channel.send(said, now_ns, positions)
        channel.deliver(now_ns)
    spent_s, busy_s = time.perf_counter() - start, time.process_time() - started
    counts = channel.counts
    spent = f"{spent_s:.2f} s ({busy_s:.2f} s of a core)"
    print(f"\nchannel, {name}, {agents} agents: {counts.sent} messages of 100 kB in {spent}; {counts}")
    assert counts.sent == 10_000
