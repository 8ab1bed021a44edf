"""The exchange of messages: in each frame from the agents' uplinks, over the channel, into inboxes."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import compress
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast

from coopsim.comms.channel.channel import Channel
from coopsim.comms.codecs.codec import CODECS
from coopsim.comms.codecs.dsrc import MAPEM, SPATEM
from coopsim.comms.codecs.maneuvers import DENM, MCM
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.intent_broadcast import IntentBroadcast
from coopsim.comms.radio.obstruction import RadioScene
from coopsim.comms.signal_broadcast import SignalBroadcast
from coopsim.comms.uplinks.budget import Selection, WithinBudget, make_selection
from coopsim.comms.uplinks.by_action import SaidByAction
from coopsim.comms.uplinks.uplink import ContentUplink, Uplink, uplink_factory
from coopsim.config.spec import parse_spec
from coopsim.envs.frames import Frame, FrameSource
from coopsim.envs.options import CommonOptions
from coopsim.errors import InvalidValueError
from coopsim.interfaces.lying_agents import LyingAgents
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, Message, Observation
from coopsim.types.lies import Lie
from coopsim.types.messages import MessagePart, Said

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy


_BESIDE = (SPATEM, MAPEM, MCM, DENM)


class Exchange:
    """Messages of an episode.

    Args:
        options: the environment's options.
        source: the episode's frames, of which it is told the agents, and the buildings and lights of their place.
        seed: the episode's.

    Attributes:
        channel: the channel.
        lies: the lies of the latest frame.
        uplink_s: wall time that the making of messages has taken: a network's encoder is there.
    """

    def __init__(self, options: CommonOptions, source: FrameSource, seed: int) -> None:
        specs, junctions = source.specs, source.junctions
        self.channel = Channel(options.channel_config, seed)
        self.lies: tuple[Lie, ...] = ()
        self.uplink_s = 0.0
        self._liars = LyingAgents(options.attacks, specs, seed, network_of(options), source.open_facts)
        self._uplinks = make_uplinks(options, specs, seed, self._liars)
        self._buildings = source.road_map.buildings if options.channel_config.radio is not None else None
        units = [name for name, spec in specs.items() if spec.kind == "rsu"]
        self._signals = SignalBroadcast(junctions, units) if junctions else None
        beside = {name: uplink.beside for name, uplink in self._uplinks.items() if uplink.beside}
        self._intents, self._source = IntentBroadcast(beside) if beside else None, source
        self._by_action = {name: each for name, each in self._uplinks.items() if isinstance(each, SaidByAction)}
        self._asked: dict[str, frozenset[str]] = {}
        self._counted: dict[str, int] = {}

    def step(self, frame: Frame) -> dict[str, Observation]:
        """Send every agent's message, deliver all due messages, and return the frame's observations with inboxes.

        Messages that actions say were sent by `tell`, after the frame before.
        """
        self._liars.begin_frame({name: agent.observation for name, agent in frame.agents.items()})
        if not self._by_action:
            messages, further = self._messages(frame)
            self._send(messages, frame, further=further)
        self.lies = self._liars.lies({name: agent.body.world_SE3_base for name, agent in frame.agents.items()})
        arrived = self.channel.deliver(frame.time_ns)
        received = {
            name: _with_messages(agent.observation, _by_capture(arrived.get(name, [])))
            for name, agent in frame.agents.items()
        }
        for name, observation in received.items():
            self._uplinks[name].hear(name, observation)
        self._liars.hear(received)
        return received

    def compose(self, frame: Frame, said: Mapping[str, Said]) -> dict[str, Message]:
        """Return the messages by sender that actions say for this frame; nothing changes.

        Raises:
            InvalidActionError: names the agent, and says what is wrong with its payload.
        """
        made = {
            name: uplink.said(name, frame.agents[name].observation, said[name])
            for name, uplink in self._by_action.items()
            if name in said
        }
        return {name: message for name, message in made.items() if message is not None}

    def tell(self, frame: Frame, messages: Mapping[str, Message], said: Mapping[str, Said]) -> None:
        """Send the messages that `compose` returned for this frame, and take notice of what is asked for."""
        if not self._by_action:
            return
        to = {sender: self._addressed(sender, said[sender]) for sender in messages}
        self._send([messages[name] for name in frame.agents if to.get(name)], frame, to)
        self._asked = {
            name: frozenset(compress(self._uplinks, each.ask)) for name, each in said.items() if each.ask is not None
        }

    @property
    def facts(self) -> dict[str, Any]:
        """Names of the agents that may lie; see `coopsim.episode.Episode`."""
        return {"attackers": self._liars.names} if self._liars.names else {}

    def sent_bytes(self) -> dict[str, int]:
        """Return the bytes that each agent has broadcast since the last call."""
        before, self._counted = self._counted, {name: self.channel.broadcast_bytes(name) for name in self._uplinks}
        return {name: size - before.get(name, 0) for name, size in self._counted.items()}

    def _addressed(self, sender: str, said: Said) -> frozenset[str]:
        """Return the agents that a message is for: chosen by its sender, and having asked if one must."""
        others = [name for place, name in enumerate(self._uplinks) if said.to is None or said.to[place]]
        if self._by_action[sender].part.ask:
            others = [name for name in others if sender in self._asked.get(name, ())]
        return frozenset(others) - {sender}

    def _send(
        self,
        messages: list[Message],
        frame: Frame,
        to: Mapping[str, frozenset[str]] | None = None,
        further: Mapping[str, Sequence[Message]] | None = None,
    ) -> None:
        bodies = {name: agent.body for name, agent in frame.agents.items()}
        positions = {name: body.world_SE3_base.translation for name, body in bodies.items()}
        around = None
        if self._buildings is not None:
            around = RadioScene.of(bodies, frame.actors, self._buildings)
        poses = {name: agent.observation.pose for name, agent in frame.agents.items()}
        if self._signals is not None:
            further = _joined(further, self._signals.messages(frame.time_ns, positions, poses))
        if self._intents is not None:
            cars = {name: car for name in frame.agents if (car := self._source.car_ahead(name)) is not None}
            further = _joined(further, self._intents.messages(frame.time_ns, cars, poses))
        self.channel.send(messages, frame.time_ns, positions, around, to, further)

    def _messages(self, frame: Frame) -> tuple[list[Message], dict[str, Sequence[Message]]]:
        """Ask each uplink once for the messages of all agents that it serves; in the order of the agents.

        Also returned are the further messages that liars send, by agent.
        """
        served: dict[Uplink, dict[str, Observation]] = {uplink: {} for uplink in self._uplinks.values()}
        for name, agent in frame.agents.items():
            if agent.observation.sensed:
                uplink = self._uplinks[name]
                served[uplink][name] = self._liars.observed(name, agent.observation, uplink.content)
        sent: dict[str, Message] = {}
        started = time.perf_counter()
        for uplink, observed in served.items():
            for name, message in uplink.messages(observed).items():
                sent[name] = _checked(uplink, name, message)
        self.uplink_s += time.perf_counter() - started
        chosen = {name: self._liars.send(name, sent.get(name)) for name in frame.agents}
        messages = [message for message, _ in chosen.values() if message is not None]
        return messages, {name: further for name, (_, further) in chosen.items() if further}


def network_of(options: CommonOptions) -> Policy | None:
    """Return the policy that makes the messages, whose weights an attacker may know; None: no policy does."""
    return cast("Policy", options.uplink) if hasattr(options.uplink, "make_uplink") else None


def make_uplinks(
    options: CommonOptions, specs: Mapping[str, AgentSpec], seed: int, liars: LyingAgents | None = None
) -> dict[str, Uplink]:
    """Make the uplinks of an episode, by agent; several agents may share one object. Those of `liars` are theirs.

    Raises:
        UnknownNameError: there is no such uplink, or no such codec for it.
        InvalidValueError: the uplink has no choice of codecs, cannot be kept within a budget, or is the action's while
            there are attacks.
    """
    make, decoded = uplink_factory(options.uplink, options.codec), DecodeOnce()
    liars = liars or LyingAgents(options.attacks, specs, seed, network_of(options))

    def selection_of(agent: str) -> Selection:
        return make_selection(options.selection, stream(seed, "selection", agent))

    uplinks: dict[str, Uplink] = {}
    for name, spec in specs.items():
        spec = replace(spec, uplink="none", codec=options.codec)
        uplink = uplinks[name] = make(spec, stream(seed, "uplink", name))
        _require_uplink(uplink, options.codec)
        if isinstance(uplink, SaidByAction):
            if options.attacks:
                raise InvalidValueError('attacks cannot be combined with uplink="action": there the action itself lies')
            uplink.budget_bytes = options.budget_bytes
        uplink.begin(spec, stream(seed, "uplink state", name))
    sending: dict[Uplink, Uplink] = {}
    for uplink in uplinks.values():
        if uplink not in sending:
            lying = liars.uplink(uplink, [name for name, each in uplinks.items() if each is uplink])
            within = None if isinstance(uplink, SaidByAction) else options.budget_bytes
            sending[uplink] = lying if within is None else WithinBudget(lying, within, selection_of, decoded)
    return {name: sending[uplink] for name, uplink in uplinks.items()}


def message_parts(uplinks: Mapping[str, Uplink]) -> dict[str, MessagePart]:
    """Return the parts `message` of actions, by the agents whose actions have one."""
    agents = tuple(uplinks)
    return {name: replace(each.part, agents=agents) for name, each in uplinks.items() if isinstance(each, SaidByAction)}


def _require_uplink(uplink: object, codec: str | None) -> None:
    if not isinstance(uplink, Uplink):
        raise InvalidValueError(f"uplink must make an Uplink for each agent, got {uplink!r}")
    if codec is None:
        return
    chosen = uplink.codec_name if isinstance(uplink, (ContentUplink, SaidByAction)) else None
    if chosen != parse_spec("codec", codec)[0]:
        raise InvalidValueError(
            f"codec must be None for {type(uplink).__name__}, which is made without regard to it, got {codec!r}"
        )


def _checked(uplink: Uplink, sender: str, message: object) -> Message:
    """Return what an uplink made if it is a message of that sender by a registered codec."""
    if isinstance(message, Message) and message.sender == sender and message.codec in CODECS:
        return message
    got = f"one of {message.sender} by codec {message.codec!r}" if isinstance(message, Message) else repr(message)
    maker, accepted = type(uplink).__name__, ", ".join(CODECS)
    raise InvalidValueError(f"{maker} must make messages of {sender} by a registered codec ({accepted}), got {got}")


def _joined(
    further: Mapping[str, Sequence[Message]] | None, more: Mapping[str, Sequence[Message]]
) -> Mapping[str, Sequence[Message]]:
    """Return the further messages of each agent, and more of them."""
    return {**more, **{name: [*sent, *more.get(name, ())] for name, sent in (further or {}).items()}}


def _with_messages(observation: Observation, messages: Sequence[Message]) -> Observation:
    """Return an observation with what arrived; ETSI's messages beside detections are not in the inbox."""
    signals = tuple(message.payload for message in messages if message.codec in _BESIDE)
    if signals:
        messages = [message for message in messages if message.codec not in _BESIDE]
    return replace(observation, inbox=tuple(messages), signals=signals)


def _by_capture(messages: Sequence[Message]) -> tuple[Message, ...]:
    return tuple(sorted(messages, key=attrgetter("captured_ns")))
