"""Who says what to whom: in each frame the agents' messages, over the channel, into inboxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from coopsim.comms.channel.channel import Channel
from coopsim.comms.radio.obstruction import Surroundings
from coopsim.comms.uplinks.budget import WithinBudget
from coopsim.comms.uplinks.selection import SELECTIONS
from coopsim.comms.uplinks.uplink import Uplink, uplink_maker
from coopsim.envs.frames import Frame
from coopsim.envs.options import CommonOptions
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Message, Observation


class Exchange:
    """One episode's messages.

    Attributes:
        channel: over which they go.

    Args:
        options: which uplink, codec, budget and channel.
        agents: names.
        buildings: outlines (K, 2) m of what stands between antennas.
        seed: the episode's.
    """

    def __init__(self, options: CommonOptions, agents: Sequence[str], buildings: Sequence[Floats], seed: int) -> None:
        self.channel = Channel(options.channel_config, seed)
        self._uplinks = {name: make_uplink(options, name, seed) for name in agents}
        self._buildings = buildings if options.channel_config.radio is not None else None

    def step(self, frame: Frame) -> dict[str, Observation]:
        """Send every agent's message, and deliver what is due: the frame's observations, with their inboxes."""
        bodies = {name: agent.body for name, agent in frame.agents.items()}
        positions = {name: body.world_SE3_base.translation for name, body in bodies.items()}
        around = None
        if self._buildings is not None:
            around = Surroundings.of(bodies, frame.actors, self._buildings)
        said = [self._uplinks[name].message(name, agent.observation) for name, agent in frame.agents.items()]
        self.channel.send([each for each in said if each is not None], frame.time_ns, positions, around)
        arrived = self.channel.deliver(frame.time_ns)
        heard = {
            name: replace(agent.observation, inbox=_by_capture(arrived.get(name, [])))
            for name, agent in frame.agents.items()
        }
        for name, observation in heard.items():
            self._uplinks[name].hear(observation)
        return heard


def make_uplink(options: CommonOptions, agent: str, seed: int) -> Uplink:
    """What makes an agent's messages in an episode.

    Raises:
        UnknownNameError: there is no such uplink, or no such codec for it.
        InvalidValueError: the uplink has no choice of codecs, or cannot be kept within a budget.
    """
    uplink = uplink_maker(options.uplink, options.codec)()
    if options.budget_bytes is None:
        return uplink
    selection = SELECTIONS.get(options.selection)(stream(seed, "selection", agent))
    return WithinBudget(uplink, options.budget_bytes, selection)


def _by_capture(messages: Sequence[Message]) -> tuple[Message, ...]:
    return tuple(sorted(messages, key=lambda message: message.captured_ns))
