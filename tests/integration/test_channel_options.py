"""Channels as options: an ideal one is none at all, and one that is written down is the one that is built."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.comms.bandwidth import Bandwidth
from coopsim.comms.channel import ChannelConfig, ChannelCounts
from coopsim.comms.clock import AgentClock
from coopsim.comms.config_files import channel_config
from coopsim.comms.latency import EmpiricalLatency, GammaLatency, GaussianLatency
from coopsim.comms.loss import BernoulliLoss, GilbertElliottLoss
from coopsim.comms.radio import Radio
from coopsim.envs import parallel
from coopsim.envs.options import CommonOptions
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.metrics.score import Score
from coopsim.types import Message

SHORT: dict[str, Any] = {"vehicles": 10, "lidar": None, "max_cycles": 12}

WRITTEN = """
latency: {model: gamma, mean_s: 0.1, jitter_s: 0.05}
loss: {model: gilbert_elliott, begin: 0.05, end: 0.5}
processing_s: 0.02
bandwidth: {rate_bit_s: 6.0e+6, order: newest_first, max_wait_s: 0.3}
radio: {scene: highway}
duplication: 0.1
clocks:
  cav_1: {rate_hz: 5, phase_s: 0.1, drift_ppm: 20}
"""

BUILT = ChannelConfig(
    GammaLatency(0.1, 0.05),
    GilbertElliottLoss(0.05, 0.5),
    processing_s=0.02,
    bandwidth=Bandwidth(6e6, order="newest_first", max_wait_s=0.3),
    radio=Radio("highway"),
    duplication=0.1,
    clocks={"cav_1": AgentClock(5, phase_s=0.1, drift_ppm=20)},
)


class NoChannel:
    """Messages are handed over as they are: nothing is encoded, drawn or queued."""

    def __init__(self, config: ChannelConfig, seed: int) -> None:
        self._handed: dict[str, list[Message]] = {}
        self.counts = ChannelCounts()

    def send(self, message: Message, now_ns: int, positions: Mapping[str, Any], around: object) -> None:
        for receiver in positions:
            if receiver != message.sender:
                self._handed.setdefault(receiver, []).append(message)

    def deliver(self, now_ns: int) -> dict[str, list[Message]]:
        handed, self._handed = self._handed, {}
        return handed

    def broadcast_bytes(self, agent: str) -> int:
        return 0


def values(**options: Any) -> dict[str, Any]:
    score = coopsim.evaluate("late_fusion", "crossing", seed=3, **(SHORT | options)).score
    return {agent: _heard(part) for agent, part in {"mean": score, **score.agents}.items()}


def _heard(score: Score) -> dict[str, str]:
    return {name: repr(value) for name, value in score.values.items() if name != "bytes_per_s"}


def test_an_ideal_channel_scores_bit_by_bit_as_none(monkeypatch: pytest.MonkeyPatch) -> None:
    ideal = values()
    neutral = ChannelConfig(
        EmpiricalLatency((0.0,)),
        GilbertElliottLoss(0.0, 1.0, 0.0),
        bandwidth=Bandwidth(1e15),
        radio=Radio(power_dbm=500.0),
    )
    assert values(channel=neutral) == ideal
    monkeypatch.setattr(parallel, "Channel", NoChannel)
    assert values() == ideal


def test_a_written_channel_is_the_one_that_is_built(tmp_path: Path) -> None:
    path = tmp_path / "channel.yaml"
    path.write_text(WRITTEN)
    assert channel_config(path) == channel_config(str(path)) == BUILT
    assert CommonOptions(channel=path).channel_config == BUILT
    delays = tmp_path / "delays.csv"
    delays.write_text("0.1\n0.2\n")
    read = channel_config({"latency": {"model": "empirical", "path": delays}, "loss": BernoulliLoss(0.5)})
    assert read == ChannelConfig(EmpiricalLatency((0.1, 0.2)), BernoulliLoss(0.5))


def test_simple_options_are_a_channel() -> None:
    simple = CommonOptions(latency_s=0.1, latency_jitter_s=0.02, loss=0.3, communication_range_m=50.0)
    assert simple.channel_config == ChannelConfig(GaussianLatency(0.1, 0.02), BernoulliLoss(0.3), 50.0)


def test_everything_at_once_runs_and_is_the_same_again() -> None:
    def run() -> tuple[ChannelCounts, Any]:
        result = coopsim.evaluate("late_fusion", "crossing", seed=1, channel=BUILT, **SHORT)
        return result.messages, result.score["MOTA"]

    first = run()
    assert first == run()
    assert first[0].sent == first[0].delivered + first[0].lost + first[0].pending > 0


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        (5, InvalidValueError, "channel must be a ChannelConfig, a mapping or the path of a YAML file, got 5"),
        ("nowhere.yaml", InvalidValueError, "cannot read the channel in nowhere.yaml"),
        ({"latencies": 1}, UnknownNameError, "unknown channel option 'latencies'.*latency"),
        ({"latency": 0.1}, InvalidValueError, "latency must be a mapping, got 0.1"),
        ({"latency": {"mean_s": 0.1}}, UnknownNameError, "unknown latency model None.*Accepted: empirical, gamma"),
        ({"loss": {"model": "bernouli"}}, UnknownNameError, "unknown loss model 'bernouli'.*bernoulli"),
        ({"loss": {"model": ["a"]}}, UnknownNameError, "unknown loss model"),
        ({"loss": {"model": "bernoulli", "p": 1}}, UnknownNameError, "unknown loss option 'p'"),
        ({"loss": {"model": "gilbert_elliott"}}, InvalidValueError, "loss: .*missing.*'begin' and 'end'"),
        ({"bandwidth": {"rate_bit_s": "fast"}}, InvalidValueError, "rate_bit_s must be .* got 'fast'"),
        ({"clocks": {"cav_0": {"hz": 5}}}, UnknownNameError, "unknown clock of cav_0 option 'hz'"),
    ],
)
def test_a_bad_channel_is_refused_by_name(given: Any, error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        CommonOptions(channel=given)


def test_two_channels_are_one_too_many() -> None:
    with pytest.raises(InvalidValueError, match="latency_s is not an option beside channel"):
        CommonOptions(channel=ChannelConfig(), latency_s=0.1)
