"""Channels as options: an ideal one is none at all, and one that is written down is the one that is built."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import yaml

import coopsim
from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.channel import ChannelConfig, ChannelCounts
from coopsim.comms.channel.channel_config import AgentClock, LinkConfig, channel_config
from coopsim.comms.channel.latency import EmpiricalLatency, GammaLatency, GaussianLatency
from coopsim.comms.channel.loss import BernoulliLoss, GilbertElliottLoss
from coopsim.comms.radio.radio_config import Radio
from coopsim.envs import exchange
from coopsim.envs.options import CommonOptions
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.localization.localizer import localization_config
from coopsim.metrics.score import Score
from coopsim.types import Message

SHORT: dict[str, Any] = {"vehicles": 10, "lidar": None, "max_cycles": 12}

WRITTEN = """
latency: {model: gamma, mean_s: 0.1, jitter_s: 0.05}
loss: {model: gilbert_elliott, begin: 0.05, end: 0.5}
processing_s: {cav_0: 0.02}
bandwidth: {rate_bit_s: 6.0e+6, order: newest_first, max_wait_s: 0.3}
radio: {scene: highway, mcs: 11}
duplication: 0.1
clocks:
  cav_1: {rate_hz: 5, phase_s: 0.1, drift_ppm: 20}
links:
  rsu_0 > *: {latency: {model: gaussian, mean_s: 0.005}, loss: {model: bernoulli}, wired: true}
  "* > rsu_0": {}
"""

BUILT = ChannelConfig(
    GammaLatency(0.1, 0.05),
    GilbertElliottLoss(0.05, 0.5),
    processing_s={"cav_0": 0.02},
    bandwidth=Bandwidth(6e6, order="newest_first", max_wait_s=0.3),
    radio=Radio("highway", mcs=11),
    duplication=0.1,
    clocks={"cav_1": AgentClock(5, phase_s=0.1, drift_ppm=20)},
    links={"rsu_0 > *": LinkConfig(GaussianLatency(0.005), BernoulliLoss(), wired=True), "* > rsu_0": LinkConfig()},
)


class NoChannel:
    """Messages are handed over as they are: nothing is encoded, drawn or queued."""

    def __init__(self, config: ChannelConfig, seed: int) -> None:
        self._handed: dict[str, list[Message]] = {}
        self.counts, self.link_counts = ChannelCounts(), {}  # type: ignore[var-annotated]

    def send(
        self, messages: Sequence[Message], now_ns: int, positions: Mapping[str, Any], around: object, *further: object
    ) -> None:
        for message in messages:
            for receiver in set(positions) - {message.sender}:
                self._handed.setdefault(receiver, []).append(message)

    def deliver(self, now_ns: int) -> dict[str, list[Message]]:
        handed, self._handed = self._handed, {}
        return handed

    def broadcast_bytes(self, agent: str) -> int:
        return 0


def values(policy: str = "late_fusion", **options: Any) -> dict[str, Any]:
    score = coopsim.evaluate(policy, "crossing", seed=3, **(SHORT | options)).score
    return {agent: _heard(part) for agent, part in {"mean": score, **score.agents}.items()}


def _heard(score: Score) -> dict[str, str]:
    return {name: repr(value) for name, value in score.values.items() if name != "bytes_per_s"}


@pytest.mark.parametrize("policy", ["late_fusion", "track_to_track"])
def test_an_ideal_channel_scores_bit_by_bit_as_none(policy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ideal = values(policy)
    neutral = ChannelConfig(
        EmpiricalLatency((0.0,)),
        GilbertElliottLoss(0.0, 1.0, 0.0),
        bandwidth=Bandwidth(1e15),
        radio=Radio(power_dbm=500.0),
        clocks=AgentClock(1000.0),
        links={"* > *": LinkConfig(wired=True), "cav_0 > *": LinkConfig()},
    )
    assert values(policy, channel=neutral) == ideal
    assert values(policy, channel={}) == ideal
    assert values(policy, latency_s=0.3) != ideal
    monkeypatch.setattr(exchange, "Channel", NoChannel)
    assert values(policy) == ideal


def test_links_are_counted_one_by_one_and_in_the_evaluation() -> None:
    cable = {"links": {"rsu_0 > *": {"latency": {"model": "gaussian", "mean_s": 0.0}, "wired": True}}}
    channel = {"latency": {"model": "gaussian", "mean_s": 0.25}, "radio": {"power_dbm": -300}, **cable}
    result = coopsim.evaluate("late_fusion", "crossing", channel=channel, **SHORT)
    agents = {sender for sender, _ in result.links}
    assert set(result.links) == {(a, b) for a in agents for b in agents if a != b}
    for (sender, _), counts in result.links.items():
        assert counts.sent == 13 and (counts.delivered, counts.lost) == ((13, 0) if sender == "rsu_0" else (0, 13))
    totals = {field.name: getattr(result.messages, field.name) for field in fields(ChannelCounts)}
    assert totals == {name: sum(getattr(each, name) for each in result.links.values()) for name in totals}


def test_a_link_of_nobody_is_refused() -> None:
    for option, given in {"links": {"rsu_7 > *": {}}, "processing_s": {"rsu_7": 0.1}, "clocks": {"rsu_7": {}}}.items():
        with pytest.raises(UnknownNameError, match=f"unknown agent in {option} 'rsu_7'. Did you mean 'rsu_0'"):
            coopsim.parallel_env("crossing", channel={option: given}, **SHORT)


def test_a_written_channel_is_the_one_that_is_built(tmp_path: Path) -> None:
    path = tmp_path / "channel.yaml"
    path.write_text(WRITTEN)
    assert channel_config(path) == channel_config(str(path)) == BUILT
    assert CommonOptions(channel=path).channel_config == BUILT
    delays = tmp_path / "delays.csv"
    delays.write_text("0.1\n0.2\n")
    read = channel_config({"latency": {"model": "empirical", "path": delays}, "loss": BernoulliLoss(0.5)})
    assert read == ChannelConfig(EmpiricalLatency((0.1, 0.2)), BernoulliLoss(0.5))


def test_what_the_documentation_writes_can_be_read() -> None:
    docs = Path(__file__).parents[2] / "docs" / "reference"
    read = {"channel": channel_config, "localization": localization_config}
    for name, config in read.items():
        blocks = re.findall(r"```yaml\n(.*?)```", (docs / f"{name}.md").read_text(), re.DOTALL)
        assert blocks
        for block in blocks:
            config(yaml.safe_load(block))  # type: ignore[operator]


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
        ("nowhere.yaml", InvalidValueError, "channel: cannot read nowhere.yaml"),
        ({"latencies": 1}, UnknownNameError, "unknown channel option 'latencies'. Did you mean 'latency'"),
        ({"range": 5}, UnknownNameError, "unknown channel option 'range'. Did you mean 'range_m'"),
        ({"range_m": -1}, InvalidValueError, "channel: range_m must be >= 0"),
        ({"bit_error_rate": 1}, InvalidValueError, r"channel: bit_error_rate must be in \[0, 0.5\], got 1"),
        ({"processing_s": {"cav_0": "a"}}, InvalidValueError, "channel: processing_s of cav_0 must be .* got 'a'"),
        ({"latency": None}, InvalidValueError, "channel: latency and loss must be models, got None"),
        ({"latency": 0.1}, InvalidValueError, "channel latency must be a mapping, got 0.1"),
        ({"latency": {"mean_s": 0.1}}, InvalidValueError, r"channel latency: model must be given, got \['mean_s'\]"),
        ({"latency": {"model": "gauss"}}, UnknownNameError, "unknown channel latency model 'gauss'.* 'gaussian'"),
        ({"latency": {"model": "gamma", "mean": 1}}, UnknownNameError, "channel latency option 'mean'.* 'mean_s'"),
        ({"latency": {"model": "gaussian", "mean_s": -1}}, InvalidValueError, "channel latency: mean_s must be in"),
        ({"latency": {"model": "empirical"}}, InvalidValueError, "either path or samples_s, got"),
        ({"latency": {"model": "empirical", "pfad": "a"}}, UnknownNameError, "latency option 'pfad'.* path, samples_s"),
        (
            {"latency": {"model": "empirical", "samples_s": 5, "path": "a"}},
            InvalidValueError,
            "either path or samples_s",
        ),
        ({"latency": {"model": "empirical", "path": 5}}, InvalidValueError, "must be a str or a Path, got 5"),
        (
            {"latency": {"model": "empirical", "samples_s": -1}},
            InvalidValueError,
            "channel latency: samples_s must be in",
        ),
        ({"loss": {"model": "bernouli"}}, UnknownNameError, "unknown channel loss model 'bernouli'.*bernoulli"),
        ({"loss": {"model": ["a"]}}, UnknownNameError, "unknown channel loss model"),
        ({"loss": {"model": "bernoulli", "p": 1}}, UnknownNameError, "unknown channel loss option 'p'"),
        ({"loss": {"model": "gilbert_elliott"}}, InvalidValueError, "channel loss: begin and end must be given"),
        ({"bandwidth": {"rate_bit_s": "fast"}}, InvalidValueError, "bandwidth: rate_bit_s must be .* got 'fast'$"),
        ({"bandwidth": {"rate_bit_s": "6e6"}}, InvalidValueError, r"'6e6' is a text in YAML: write it like 6.0e\+6"),
        ({"bandwidth": {"rate": 1}}, UnknownNameError, "unknown channel bandwidth option 'rate'.* 'rate_bit_s'"),
        ({"bandwidth": {"rate_bit_s": 1, "order": "new"}}, UnknownNameError, "unknown channel bandwidth order 'new'"),
        ({"radio": True}, InvalidValueError, "channel radio must be a mapping, got True"),
        ({"radio": {"scene": "city"}}, UnknownNameError, "unknown channel radio scene 'city'"),
        ({"radio": {"mcs": 5}}, InvalidValueError, "channel radio: mcs must be one of 4, 7, 11, got 5"),
        ({"clocks": {"cav_0": {"hz": 5}}}, UnknownNameError, "unknown channel clock of cav_0 option 'hz'"),
        ({"clocks": {"rate_hz": 0}}, InvalidValueError, "channel clocks: rate_hz must be in"),
        ({"links": ["a > b"]}, InvalidValueError, "channel links must be a mapping"),
        ({"links": {"rsu_0": {}}}, InvalidValueError, "\"sender > receiver\".*got 'rsu_0'"),
        ({"links": {"a > b": {"lost": 1}}}, UnknownNameError, "unknown channel link a > b option 'lost'.* 'loss'"),
        ({"links": {"a > b": {"latency": 1}}}, InvalidValueError, "channel link a > b latency must be a mapping"),
        ({"links": {"a > b": {"loss": {"model": "b"}}}}, UnknownNameError, "unknown channel link a > b loss model 'b'"),
    ],
)
def test_a_bad_channel_is_refused_by_name(given: Any, error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        CommonOptions(channel=given)


def test_two_channels_are_one_too_many() -> None:
    with pytest.raises(InvalidValueError, match="latency_s cannot be combined with channel"):
        CommonOptions(channel=ChannelConfig(), latency_s=0.1)
