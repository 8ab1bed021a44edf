"""Configuration of a channel as plain data, of agents' clocks, and of overrides for single links."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.latency import LATENCIES, MOST_S, GaussianLatency, Latency
from coopsim.comms.channel.loss import LOSSES, BernoulliLoss, Loss
from coopsim.comms.radio.radio_config import Radio
from coopsim.config.load import load, read_mapping
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_between, require_flag, require_instance, require_number, require_probability
from coopsim.types import NS_PER_S, seconds_to_ns

_MOST_PPM = 1e4
_LATEST_NS = 2**62 - 1  # the largest that fits an observation's space
_ROUNDING_NS = 2  # frames' times are rounded: a tick that falls on a frame belongs to it


@dataclass(frozen=True, slots=True)
class AgentClock:
    """Clock of an agent.

    Sensors are read in frames: after a tick between two frames an agent sends the content of the second frame, and
    after several ticks between them it sends once.

    Attributes:
        rate_hz: ticks, and so messages, per second; None: one in each frame.
        phase_s: time of the first tick since the episode's start.
        offset_s: time by which stamps are ahead of true time, in [-3600, 3600].
        drift_ppm: microseconds per second that stamps gain, in [-1e4, 1e4].
        offset_noise_s: standard deviation of the noise on `offset_s`, drawn for each episode, in [0, 3600].
        drift_noise_ppm: standard deviation of the noise on `drift_ppm`, drawn for each episode, in [0, 1e4].
    """

    rate_hz: float | None = None
    phase_s: float = 0.0
    offset_s: float = 0.0
    drift_ppm: float = 0.0
    offset_noise_s: float = 0.0
    drift_noise_ppm: float = 0.0

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            require_number("in (0, 1e+06], or None: in each frame", lambda rate: 0 < rate <= 1e6, rate_hz=self.rate_hz)
        require_between(0, MOST_S, phase_s=self.phase_s)
        require_between(-MOST_S, MOST_S, offset_s=self.offset_s)
        require_between(-_MOST_PPM, _MOST_PPM, drift_ppm=self.drift_ppm)
        require_between(0, MOST_S, offset_noise_s=self.offset_noise_s)
        require_between(0, _MOST_PPM, drift_noise_ppm=self.drift_noise_ppm)

    def sample(self, rng: np.random.Generator) -> AgentClock:
        """Draw the clock of one episode, without noise. Takes two normals from `rng`, whatever the parameters."""
        ahead, gain = rng.standard_normal(2)
        offset_s = self.offset_s + float(ahead) * self.offset_noise_s
        drift_ppm = self.drift_ppm + float(gain) * self.drift_noise_ppm
        return AgentClock(
            self.rate_hz,
            self.phase_s,
            float(np.clip(offset_s, -MOST_S, MOST_S)),
            float(np.clip(drift_ppm, -_MOST_PPM, _MOST_PPM)),
        )

    def ticks(self, before_ns: int | None, now_ns: int) -> bool:
        """Return whether it ticks in (`before_ns`, `now_ns`]: since the previous frame, None if there is none."""
        return self._count(now_ns) > (0 if before_ns is None else self._count(before_ns))

    def stamp_ns(self, true_ns: int) -> int:
        """Return the clock's reading at a true time, at least 0."""
        ahead = self.offset_s + self.drift_ppm * 1e-6 * true_ns / NS_PER_S
        return min(max(0, true_ns + seconds_to_ns(ahead)), _LATEST_NS)

    def _count(self, now_ns: int) -> int:
        """Return the number of ticks until then."""
        since_ns = now_ns + _ROUNDING_NS - seconds_to_ns(self.phase_s)
        if since_ns < 0:
            return 0
        return now_ns + 1 if self.rate_hz is None else int(since_ns * self.rate_hz / NS_PER_S) + 1


ANYONE = "*"


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """Overrides of the channel on some links.

    Attributes:
        latency: replaces the channel's; None: the channel's.
        loss: replaces the channel's; None: the channel's.
        wired: a cable, without limits of range, radio or bandwidth.
    """

    latency: Latency | None = None
    loss: Loss | None = None
    wired: bool = False

    def __post_init__(self) -> None:
        require_instance(Latency, latency=self.latency)
        require_instance(Loss, loss=self.loss)
        require_flag(wired=self.wired)


_NO_OVERRIDE = LinkConfig()


def require_links(links: Mapping[str, LinkConfig]) -> None:
    """Raise `InvalidValueError` if a key is not of the form "sender > receiver", or a value no `LinkConfig`."""
    if not isinstance(links, Mapping):
        raise InvalidValueError(f'links must be LinkConfigs by "sender > receiver", got {links!r}')
    for name, link in links.items():
        if not isinstance(link, LinkConfig):
            raise InvalidValueError(f'links must be LinkConfigs by "sender > receiver"; got {link!r} for {name!r}')
    pairs = list(_pairs(links))
    for name, pair in zip(links, pairs, strict=True):
        if pairs.count(pair) > 1:
            raise InvalidValueError(f"links has {name!r} twice")


def link_of(links: Mapping[str, LinkConfig], sender: str, receiver: str) -> LinkConfig:
    """Return the override of a link: the one that names both agents, else the sender, the receiver, or neither."""
    by_pair = dict(zip(_pairs(links), links.values(), strict=True))
    for pair in ((sender, receiver), (sender, ANYONE), (ANYONE, receiver), (ANYONE, ANYONE)):
        if pair in by_pair:
            return by_pair[pair]
    return _NO_OVERRIDE


def agents_in(links: Mapping[str, LinkConfig]) -> set[str]:
    """Return the names of all agents in the keys of `links`."""
    return {agent for pair in _pairs(links) for agent in pair if agent != ANYONE}


def _pairs(links: Mapping[str, LinkConfig]) -> Iterator[tuple[str, str]]:
    for name in links:
        sender, arrow, receiver = str(name).partition(">")
        pair = sender.strip(), receiver.strip()
        if not (arrow and all(pair)) or ">" in receiver:
            raise InvalidValueError(
                f'a link in links is "sender > receiver", where "*" is any agent, as "rsu_0 > *"; got {name!r}'
            )
        yield pair


_EVERY_FRAME = AgentClock()


@dataclass(frozen=True, slots=True)
class ChannelConfig:
    """Configuration of the channel; the default is ideal.

    A message is made at a tick of its sender's clock, is ready after `processing_s`, waits for the medium and is sent
    (`bandwidth`), and arrives after `latency`, unless it is lost (`loss`), too far away (`range_m`), not received
    (`radio`) or has a wrong bit (`bit_error_rate`).

    Attributes:
        latency: delay of each message on each link.
        loss: loss of each message on each link.
        range_m: the largest distance between sender and receiver at which messages arrive.
        processing_s: time from the sensors' measurement until the message is ready to be sent, in [0, 3600]; one for
            all agents, or by agent (0 for agents that are not named).
        bandwidth: None: sending takes no time.
        radio: None: distance and obstacles do not matter within `range_m`.
        duplication: probability that a delivered message arrives a second time, after another delay.
        bit_error_rate: probability that a bit is flipped, in [0, 0.5]. The checksum finds it, and the message is lost.
        clocks: one for all agents, or by agent; agents that are not named send in every frame, with exact stamps.
        links: overrides for links by "sender > receiver", either of which may be "*". If several match a link, the
            one that names both agents applies, else the one that names the sender, else the receiver.
    """

    latency: Latency = field(default_factory=GaussianLatency)
    loss: Loss = field(default_factory=BernoulliLoss)
    range_m: float = np.inf
    processing_s: float | Mapping[str, float] = 0.0
    bandwidth: Bandwidth | None = None
    radio: Radio | None = None
    duplication: float = 0.0
    bit_error_rate: float = 0.0
    clocks: AgentClock | Mapping[str, AgentClock] = _EVERY_FRAME
    links: Mapping[str, LinkConfig] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if self.latency is None or self.loss is None:
            raise InvalidValueError("latency and loss must be models, got None: leave them out for none of it")
        require_instance(Latency, latency=self.latency)
        require_instance(Loss, loss=self.loss)
        require_instance(Bandwidth, bandwidth=self.bandwidth)
        require_instance(Radio, radio=self.radio)
        require_number(">= 0 (inf: no limit)", lambda far: far >= 0, range_m=self.range_m)
        self._check_processing()
        require_links(self.links)
        require_probability(duplication=self.duplication)
        require_between(0, 0.5, bit_error_rate=self.bit_error_rate)
        if self.radio is not None and self.radio.slots and self.bandwidth is not None:
            raise InvalidValueError(
                "radio slots and bandwidth exclude each other: in slots messages are on the air at once, "
                "and with a bandwidth one after another"
            )
        by_agent = self.clocks if isinstance(self.clocks, Mapping) else {"all": self.clocks}
        for name, clock in by_agent.items():
            if not isinstance(clock, AgentClock):
                raise InvalidValueError(f"clocks must be an AgentClock, or one by agent; got {clock!r} for {name!r}")

    def _check_processing(self) -> None:
        if isinstance(self.processing_s, Mapping):
            delays = {f"processing_s of {name}": delay for name, delay in self.processing_s.items()}
        else:
            delays = {"processing_s": self.processing_s}
        require_between(0, MOST_S, **delays)

    def processing_of(self, agent: str) -> float:
        """Return the processing time of an agent's messages, s."""
        if isinstance(self.processing_s, Mapping):
            return self.processing_s.get(agent, 0.0)
        return self.processing_s

    @property
    def agents_by_option(self) -> Mapping[str, Collection[str]]:
        """Names of agents in each option, for the environment to check."""
        by_agent = {"clocks": self.clocks, "processing_s": self.processing_s}
        named = {option: list(each) for option, each in by_agent.items() if isinstance(each, Mapping)}
        return {**named, "links": sorted(agents_in(self.links))}

    def link(self, sender: str, receiver: str) -> LinkConfig:
        """Return the overrides of the link between two agents."""
        return link_of(self.links, sender, receiver)

    def clock(self, agent: str) -> AgentClock:
        """Return an agent's clock."""
        return self.clocks if isinstance(self.clocks, AgentClock) else self.clocks.get(agent, _EVERY_FRAME)


def channel_config(given: ChannelConfig | Mapping[str, Any] | str | Path) -> ChannelConfig:
    """Make a channel from a mapping of its fields, or from the path of a YAML file with that.

    `latency` and `loss` are mappings with a `model` (see `LATENCIES` and `LOSSES`) and its parameters.

    Raises:
        InvalidValueError: the file cannot be read, or a value is not accepted.
        UnknownNameError: there is no such field or model.
    """
    if isinstance(given, ChannelConfig):
        return given
    mapping = read_mapping("channel", "a ChannelConfig", given)
    config: ChannelConfig = load(ChannelConfig, mapping, "channel", {Latency: LATENCIES, Loss: LOSSES})
    return config
