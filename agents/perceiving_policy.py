"""The base of policies that detect by a network in what all agents sent, and track what it finds.

Their networks work in the *compass frame*: the base frame's origin, turned so that its axes are the world's by the
agent's estimated heading. Maps of all agents then have the same axes, so one broadcast serves all receivers.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from coopsim.agents.tracking_policy import TrackingPolicy, nearby_messages
from coopsim.catalog import POLICIES, make_policy
from coopsim.config.spec import parse_spec
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import covers
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_between, require_count, require_positive, require_probability
from coopsim.support.methods import WeakMethod
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.motion.turning import face_velocity
from coopsim.tracking.tracker import Tracker
from coopsim.types import NS_PER_S, AgentSpec, Detections, FeatureMap, Message, Observation, Tracks, seconds_to_ns
from coopsim.types.valid_detections import drop_unreportable

_MOST_SENDERS = 32
"""Messages of more agents at once are not remembered, but for the newest: names may change for ever."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """Newest message of one sender.

    Attributes:
        message: the message.
        content: its decoded content.
        captured_ns: its capture time, not later than its arrival.
        odom_SE3_sender: the sender's base frame at capture, in the receiver's odometry frame.
    """

    message: Message
    content: Any
    captured_ns: int
    odom_SE3_sender: SE3

    def delay_s(self, now_ns: int) -> float:
        """Return its age."""
        return (now_ns - self.captured_ns) / NS_PER_S


@dataclass(kw_only=True, eq=False)
class PerceivingPolicy(TrackingPolicy):
    """A policy with detections of its own, made by a network. Further parameters: `TrackingPolicy`.

    Of each sender the newest message counts, where it was captured, until another one comes or it is too old. Networks
    on LiDARs confuse front and back, so reported tracks that move face where they go.

    Attributes:
        weights: name or path of the network's weights.
        tracker: the policy whose tracker tracks what is found, by its spec: "ab3dmot", "coop_fuse", ...
        least_score: smallest score of a detection, in [0, 1].
        region_m: the network looks for objects in |x| <= the first, |y| <= the second of the receiver's base frame,
            and in what the rectangle around it in the world's axes has besides.
        memory_s: for how long after its capture a message is used.
        threads: agents' networks are computed side by side on so many threads; the results are the same for any number.
        device: where the networks compute: "cpu"; a GPU as "cuda" or "cuda:1"; or "auto": a GPU if there is one. Agents
            are then one batch, and `threads` is without effect.
    """

    own_tracker: ClassVar[str | None] = None
    """The name of `tracker` for which the network itself tracks; None: there is none."""

    delayed: str = "as_current"
    weights: str = "pillars"
    tracker: str = "ab3dmot"
    least_score: float = 0.1
    region_m: tuple[float, float] = (100.0, 40.0)
    memory_s: float = 1.0
    threads: int = 2
    device: str = "cpu"

    def __post_init__(self) -> None:
        require_probability(least_score=self.least_score)
        require_positive(memory_s=self.memory_s)
        require_count(1, threads=self.threads)
        if not (isinstance(self.region_m, (tuple, list)) and len(self.region_m) == 2):
            raise InvalidValueError(f"region_m must be two numbers, half of length and width, got {self.region_m!r}")
        require_between(5, 300, **{"region_m[0]": self.region_m[0], "region_m[1]": self.region_m[1]})
        if self.delayed != "as_current":
            raise InvalidValueError(
                f"delayed must be left at 'as_current', got {self.delayed!r}: a network is told how late "
                "messages are, and what it finds is of now"
            )
        self._tracking = self.tracking_policy()
        self._received: dict[str, dict[str, Received]] = {}
        # Both are remembered beside what they gave, so they must stay the same objects.
        self._decode, self._decode_boxes = WeakMethod(self.decode), WeakMethod(self._claimed)
        super().__post_init__()

    def _load(self) -> None:
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.nn.inference.backend import find_backend

        self._backend = find_backend(self.device, self.threads)
        self.load()

    @abstractmethod
    def load(self) -> None:
        """Make the networks, on `_backend`; they are imported here and not above, because they need torch.

        Raises:
            UnknownNameError: there are no such weights.
            InvalidValueError: the weights are broken, or do not fit together.
        """

    @abstractmethod
    def decode(self, message: Message) -> Any:
        """Return the content of a message; a pure function. Raises `CodecError` for what cannot be used."""

    @abstractmethod
    def find(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        """Return the detections of `agent` and the senders together, in its compass frame now."""

    @abstractmethod
    def found_by(self, heading_rad: float, content: Any) -> Detections:
        """Return the detections of a sender with this heading, by its message alone, in its base frame."""

    def tracking_policy(self) -> TrackingPolicy:
        """Return the policy whose tracker is used; with the `own_tracker`, any one.

        Raises:
            UnknownNameError: there is none of that name.
            InvalidValueError: it does not track boxes.
        """
        name, parameters = parse_spec("tracker", "ab3dmot" if self.tracker == self.own_tracker else self.tracker)
        if not _tracks_boxes(name):
            accepted = ", ".join(each for each in POLICIES.names() if _tracks_boxes(each))
            raise InvalidValueError(f"tracker must be a policy that tracks boxes ({accepted}), got {self.tracker!r}")
        made = make_policy(name, **parameters)
        assert isinstance(made, TrackingPolicy)
        return made

    def make_tracker(self) -> Tracker | TrackersByClass:
        return self._tracking.make_tracker()

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return self._tracking.fuse(groups)

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        super().begin(spec, rng)
        self._received[spec.name], self._tracking.counts = {}, self.counts

    def prepare(self, observations: Mapping[str, Observation]) -> None:
        """Prepare a frame of all agents, before `find` is called for each."""

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        for agent, observation in observations.items():
            self._states[agent].frame.move(observation)
        self.prepare(observations)
        received = {agent: self._trusted(agent, observation) for agent, observation in observations.items()}
        tasks = [partial(self._perceive, agent, each, received[agent]) for agent, each in observations.items()]
        found = dict(zip(observations, self._backend.side_by_side(tasks), strict=True))
        return {agent: self._track(agent, observation, found[agent]) for agent, observation in observations.items()}

    def _track(self, agent: str, observation: Observation, found: Detections) -> Tracks:
        return face_velocity(self._follow(agent, observation, found))

    def _follow(self, agent: str, observation: Observation, found: Detections) -> Tracks:
        """Return the tracks for what is found, before those that move are turned to face where they go."""
        return super()._track(agent, observation, found)

    def perceive(self, agent: str, observation: Observation) -> Detections:
        self.prepare({agent: observation})
        return self._perceive(agent, observation, self._trusted(agent, observation))

    def _perceive(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        """Return the detections of the agent and its senders, in its base frame; may run beside other agents'."""
        if not observation.sensed:
            return Detections.empty()
        found = self.find(agent, observation, received).transform(base_SE3_compass(observation))
        return self._less_itself(agent, observation.time_ns, received, found)

    def _less_itself(self, agent: str, now_ns: int, received: Sequence[Received], found: Detections) -> Detections:
        """Return detections in the agent's base frame, less the agent: no agent is its own object."""
        if self._states[agent].is_object:
            for place_m in self._own_places(agent, now_ns, received):
                found = found[~covers(found.boxes, place_m)]
        return found

    def _own_places(self, agent: str, now_ns: int, received: Sequence[Received]) -> Floats:
        """Return the agent's places now and when late messages were captured: (M, 2) m in its base frame."""
        frame, now_m = self._states[agent].frame, np.zeros((1, 2))
        before_ns = sorted({each.captured_ns for each in received if each.captured_ns < now_ns})
        if not before_ns:
            return now_m
        return np.concatenate([now_m, frame.odom_SE3_base.inverse().apply(frame.positions_at(before_ns))[:, :2]])

    def odom_SE3_compass(self, agent: str, observation: Observation) -> SE3:
        """Return the agent's compass frame now, in its odometry frame."""
        return self._states[agent].frame.odom_SE3_base.compose(base_SE3_compass(observation))

    def compass_SE3_sender(self, agent: str, observation: Observation, received: Received) -> SE3:
        """Return the sender's base frame at capture, in the receiver's compass frame now."""
        base_SE3_odom = self._states[agent].frame.odom_SE3_base.inverse()
        return base_SE3_compass(observation).inverse().compose(base_SE3_odom.compose(received.odom_SE3_sender))

    def _listen(self, agent: str, observation: Observation) -> list[Received]:
        """Take in the inbox, and return the newest message of each sender, in the order of their names."""
        known, now_ns = self._received[agent], observation.time_ns
        inbox = [message for message in nearby_messages(observation) if message.sender != agent]
        readable = self.read(agent, inbox, self._decode)
        places = self._places(agent, observation, readable)
        for (message, content), odom_SE3_sender in zip(readable, places, strict=True):
            captured_ns, before = min(message.captured_ns, now_ns), known.get(message.sender)
            if before is None or before.captured_ns < captured_ns:
                known[message.sender] = Received(message, content, captured_ns, odom_SE3_sender)
        oldest_ns = now_ns - seconds_to_ns(self.memory_s)
        recent = sorted((-each.captured_ns, name) for name, each in known.items() if each.captured_ns >= oldest_ns)
        self._received[agent] = {
            name: known[name] for _, name in sorted(recent[:_MOST_SENDERS], key=lambda each: each[1])
        }
        return list(self._received[agent].values())

    def _trusted(self, agent: str, observation: Observation) -> list[Received]:
        """Take in the inbox, and return the newest message of each sender that the agent believes."""
        received, guard = self._listen(agent, observation), self.guard
        if guard is None:
            return received
        heard = [(each.message, self._decoded(each.message, self._decode_boxes)) for each in received]

        def find(senders: Collection[str]) -> Detections:
            among = [each for each in received if each.message.sender in senders]
            return drop_unreportable(self._perceive(agent, observation, among))

        maps = partial(self.features, agent, observation, received)
        guard.judge(observation, agent, self._states[agent].frame, heard, find, maps)
        return [each for each in received if guard.believes(agent, each.message.sender)]

    def _claimed(self, message: Message) -> Detections:
        """Return the detections of a readable message by itself, in its sender's base frame."""
        content = self._decoded(message, self._decode)
        return drop_unreportable(self.found_by(float(message.pose.xyz_yaw[3]), content))

    def features(
        self, agent: str, observation: Observation, received: Sequence[Received], number: int
    ) -> FeatureMap | None:
        """Return the map in a message, or with -1 the one that the agent would send; None: messages hold none."""
        return None

    def _places(self, agent: str, observation: Observation, readable: Sequence[tuple[Message, Any]]) -> list[SE3]:
        """Return `odom_SE3_sender` at capture for each message, corrected by common objects if `align`."""
        state = self._states[agent]
        if state.alignment is None:
            batch = state.frame.odom_SE3_senders([message for message, _ in readable], observation)
            return [batch[number] for number in range(len(batch))]
        own = Detections.empty()
        if observation.sensed:
            own = self.find(agent, observation, []).transform(base_SE3_compass(observation))
        boxes = [(message, self._decoded(message, self._decode_boxes)) for message, _ in readable]
        placed = drop_unreportable(own).transform(state.frame.odom_SE3_base)
        return state.alignment.place(observation, state.frame, placed, boxes)


class Timed(Protocol):
    """State of an agent after a frame."""

    @property
    def time_ns(self) -> int:
        """Time of the frame."""


M = TypeVar("M", bound=Timed)


@dataclass
class FrameChain(Generic[M]):
    """States of one agent: `before`, after the frame before, and `now`, after this one or the newest so far."""

    before: M | None = None
    now: M | None = None

    def begin(self, now_ns: int) -> M | None:
        """Begin a frame, or do it once more. Return the state before it; a newer one is forgotten."""
        if self.now is not None and self.now.time_ns != now_ns:
            self.before = self.now if self.now.time_ns < now_ns else None
        return self.before


def base_SE3_compass(observation: Observation) -> SE3:
    """Return the turn from the compass frame to the base frame, by the agent's estimate of its heading."""
    return SE3.from_xyz_yaw(np.zeros(3), -float(observation.pose.xyz_yaw[3]))


def _tracks_boxes(name: str) -> bool:
    kind = POLICIES.get(name)
    return issubclass(kind, TrackingPolicy) and not issubclass(kind, PerceivingPolicy)
