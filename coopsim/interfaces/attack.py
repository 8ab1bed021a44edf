"""The seam for attacks: one hook for each layer at which an agent can lie, all of which are honest by default."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from coopsim.comms.envelope import decode_detections, decode_tracks
from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import CodecError, InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.interfaces.planner import PlannerOption
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at
from coopsim.types import NS_PER_S, AgentSpec, Detections, Ints, Message, Observation, Sweep
from coopsim.types.driving import Route
from coopsim.types.track_estimates import TrackEstimates

KNOWLEDGE = ("none", "poses", "boxes", "weights")
"""Knowledge of attackers, each with all before it: their own sensors and detections; envelopes of messages that they
hear; objects in these messages; the weights of the receivers' network."""


@dataclass(frozen=True, slots=True, eq=False)
class Victim:
    """Another agent, as an attacker knows it from the messages that it heard.

    Attributes:
        name: the agent's name.
        world_SE3_base: the agent's place now: its last stated pose, moved on by `velocity`.
        velocity: (2,) m/s over ground in the world frame, by its last two poses; zero after one message.
    """

    name: str
    world_SE3_base: SE3
    velocity: Floats


@dataclass(frozen=True, slots=True, eq=False)
class OpenFacts:
    """Facts that anybody can look up or buy, and an attacker, too. Nobody's place or plan is among them.

    Attributes:
        driven: cars that a planner or an action drives, in the environment's order.
        planner: the planner of these cars, of which an attacker may make copies; the built-in one if none drives.
        way_ahead: function from a car's place in the world to the way that a map has ahead of it, in the car's base
            frame: straight on wherever there is a choice. None: no lane is there, or there is no map.
    """

    driven: Sequence[str] = ()
    planner: PlannerOption = "idm_aeb"
    way_ahead: Callable[[SE3], Route | None] = lambda world_SE3_base: None


@dataclass(slots=True, eq=False)
class AttackerView:
    """Everything that one attack knows in one frame, and the notes of its lies.

    Attributes:
        spec: the lying agent.
        observation: the agent's own, as it is, without an inbox.
        rng: the attack's random stream.
        heard: the last two messages of each other sender, the newest last, from earlier frames; empty with the
            knowledge "none", and without payloads with "poses".
        kinds: kind of every agent, "cav", "rsu" or "drone", which all know.
        network: the policy whose weights the attack knows; None unless its knowledge is "weights".
        facts: facts that anybody can look up.
    """

    spec: AgentSpec
    observation: Observation
    rng: np.random.Generator
    heard: Mapping[str, Sequence[Message]]
    kinds: Mapping[str, str] = field(default_factory=dict)
    network: Any = None
    claims: list[tuple[Ints, Boxes3D]] = field(default_factory=list)
    denials: list[Boxes3D] = field(default_factory=list)
    senders: set[str] = field(default_factory=set)
    against: str | None = None
    facts: OpenFacts = field(default_factory=OpenFacts)

    @property
    def time_s(self) -> float:
        """Time since the episode's start."""
        return self.observation.time_ns / NS_PER_S

    @property
    def world_SE3_base(self) -> SE3:
        """The agent's own place, by its estimate, which its messages state."""
        return self.observation.pose.world_SE3_base

    def victim(self, name: str | None) -> Victim | None:
        """Return another agent by its messages; None: nothing was heard of it yet.

        Without a `name` it is the first driven car besides the agent itself: a lie is worth most to whom it can make
        brake. Where nobody else is driven it is the nearest connected car, or the nearest other agent where no car was
        heard.
        """
        if name is None:
            name = next((each for each in self.facts.driven if each != self.spec.name), None)
        if name is None:
            name = min(sorted(self.heard), key=self._strangeness, default=None)
        if name not in self.heard:
            return None
        assert name is not None
        self.against = name
        return self._place(name)

    def objects_of(self, name: str) -> Boxes3D:
        """Return the objects in an agent's last message in the world frame; none without the knowledge "boxes"."""
        for message in reversed(self.heard.get(name, ())):
            for decode in (decode_detections, _track_boxes):
                try:
                    return decode(message).boxes.transform(message.pose.world_SE3_base)
                except CodecError:
                    continue
        return Boxes3D.empty()

    def claim(self, ids: Ints, boxes: Boxes3D) -> None:
        """Note that the agent's message claims objects (N,) in its base frame that are not there."""
        if len(boxes):
            self.claims.append((ids, boxes))
        self.lie()

    def deny(self, boxes: Boxes3D) -> None:
        """Note that the agent's message leaves out or moves objects of its own detections, in its base frame."""
        if len(boxes):
            self.denials.append(boxes)
        self.lie()

    def lie(self, sender: str | None = None) -> None:
        """Note that a message of this frame lies, under the agent's own name or another."""
        self.senders.add(self.spec.name if sender is None else sender)

    def _strangeness(self, name: str) -> tuple[bool, float]:
        apart = self._place(name).world_SE3_base.translation - self.world_SE3_base.translation
        return self.kinds.get(name) != "cav", float(np.hypot(*apart[:2]))

    def _place(self, name: str) -> Victim:
        last, before = self.heard[name][-1], self.heard[name][0]
        elapsed_s = (last.captured_ns - before.captured_ns) / NS_PER_S
        moved = last.pose.xyz_yaw - before.pose.xyz_yaw
        velocity = moved[:2] / elapsed_s if elapsed_s > 0 else np.zeros(2)
        turn_rad_s = float(wrap_angle(moved[3])) / elapsed_s if elapsed_s > 0 else 0.0
        ahead_s = max(self.observation.time_ns - last.captured_ns, 0) / NS_PER_S
        place = last.pose.xyz_yaw[:3] + np.append(velocity, 0.0) * ahead_s
        yaw = float(last.pose.xyz_yaw[3]) + turn_rad_s * ahead_s
        return Victim(name, SE3.from_xyz_yaw(place, yaw), velocity)


def _track_boxes(message: Message) -> Any:
    return decode_tracks(message).tracks


@dataclass(kw_only=True)
class Attack:
    """The lies of one agent for one episode: one object for each agent and episode, so it may keep state.

    A subclass overrides the hooks of the layers at which it lies. Each is asked once in each frame from `start_s` to
    `end_s`, and notes in `view` what it changes. All others, and all other frames, are honest. The agent itself goes
    on seeing, tracking and driving honestly: the lies leave it in its messages only.

    Attributes:
        start_s: time from which the agent lies.
        end_s: time until which the agent lies.
        against: name of the receiver that is meant; None: see `AttackerView.victim`, where the attack means one.
        knowledge: knowledge that it needs, see `KNOWLEDGE`.
        contents: contents of messages that it can lie in; (): all on which its hooks have an effect.
    """

    start_s: float = 0.0
    end_s: float = math.inf
    against: str | None = None
    knowledge: ClassVar[str] = "none"
    contents: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for name in ("start_s", "end_s"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
                raise InvalidValueError(f"{name} must be a time >= 0 in seconds, got {value!r}")
        if self.end_s < self.start_s:
            raise InvalidValueError(f"end_s must be at least start_s {self.start_s:g}, got {self.end_s:g}")
        if not (self.against is None or isinstance(self.against, str)):
            raise InvalidValueError(f"against must be the name of an agent or None, got {self.against!r}")

    def accepted(self) -> tuple[str, ...]:
        """Return the contents of messages that the attack can lie in with its parameters; () for all."""
        return contents_of(type(self))

    def active(self, time_s: float) -> bool:
        """Return whether the agent lies at a time."""
        return self.start_s <= time_s <= self.end_s

    def sense(self, view: AttackerView, sweeps: Mapping[str, Sweep]) -> Mapping[str, Sweep]:
        """Return the sweeps from which the message is made; asked where it is made of points."""
        return sweeps

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        """Return the detections that the message is made of, in the agent's base frame; asked where it has any."""
        return detections

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        """Return the tracks in the message, in the agent's base frame; asked where it has any."""
        return tracks

    def encode(self, view: AttackerView, content: Any) -> Any:
        """Return the features or queries in the message, before the codec; asked where it has any."""
        return content

    def send(self, view: AttackerView, message: Message) -> Message | None:
        """Return the message that the agent sends under its own name, with this or another envelope; None: none."""
        return message

    def further(self, view: AttackerView, message: Message | None) -> Sequence[Message]:
        """Return messages that the agent's radio sends besides `message`, under any names."""
        return ()


HOOKS: Mapping[str, tuple[str, ...]] = {
    "detect": ("detections",),
    "track": ("tracks",),
    "sense": ("points", "features", "queries"),
    "encode": ("features", "queries"),
    "send": (),
    "further": (),
}
"""Hooks, and the contents of messages on which each has an effect; (): on all."""


def hooks_of(attack: type[Attack]) -> tuple[str, ...]:
    """Return the names of the hooks that a class of attacks overrides."""
    return tuple(name for name in HOOKS if getattr(attack, name) is not getattr(Attack, name))


def contents_of(attack: type[Attack]) -> tuple[str, ...]:
    """Return the contents of messages that a class of attacks can lie in; () for all."""
    hooks = hooks_of(attack)
    if attack.contents:
        return attack.contents
    if any(not HOOKS[name] for name in hooks):
        return ()
    return tuple(dict.fromkeys(content for name in hooks for content in HOOKS[name]))


ATTACKS: Registry[type[Attack]] = Registry("attack", home="coopsim.attacks.built_in", group="coopsim.attacks")
"""Attack classes. Installed packages add theirs through the entry-point group `coopsim.attacks`."""

AttackOption = str | Callable[[], Attack]
"""Attack by name, also with parameters, such as "ghost(ahead_m=15)", by the place of its class, such as
"mine.py:MyAttack", or a class or function that makes one."""

_ACCEPTED = "name, name(parameter=value, ...), module:Class or file.py:Class"


def make_attack(attack: AttackOption) -> Attack:
    """Make an attack; each agent has its own in each episode.

    Raises:
        UnknownNameError: there is no such attack, or no such parameter.
        InvalidValueError: a parameter's value is not accepted, or the place has no class of attacks.
    """
    if not isinstance(attack, str):
        if isinstance(attack, Attack) or not callable(attack):
            raise InvalidValueError(f"attack must be a name, a spec or a class of attacks, got {attack!r}")
        made = attack()
    else:
        name, parameters = parse_spec("attack", attack, _ACCEPTED)
        kind = class_at("attack", name, Attack) if ":" in name else ATTACKS.get(name)
        made = instantiate("attack", name, kind, parameters)
    if not isinstance(made, Attack):
        raise InvalidValueError(f"attack must make a coopsim.Attack, got {made!r}")
    return made
