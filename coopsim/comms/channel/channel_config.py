"""Configuration of a channel, as plain data."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.clock import AgentClock
from coopsim.comms.channel.latency import LATENCIES, MOST_S, GaussianLatency, Latency
from coopsim.comms.channel.link_config import LinkConfig, agents_in, link_of, require_links
from coopsim.comms.channel.loss import LOSSES, BernoulliLoss, Loss
from coopsim.comms.radio.radio_config import Radio
from coopsim.config.load import load, read_mapping
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_between, require_instance, require_number, require_probability

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
