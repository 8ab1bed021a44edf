"""The base of tracking-by-detection policies: collect detections, track them, report."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import TYPE_CHECKING, TypeVar, dataclass_transform

import numpy as np

from coopsim.agents.policy import Policy
from coopsim.catalog import POLICIES
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.share_intents import ShareIntents
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import InvalidValueError
from coopsim.fusion.alignment import PoseAlignment
from coopsim.geometry.boxes import covers
from coopsim.geometry.se3 import Floats, SE3Batch
from coopsim.interfaces.box_covariance import COVARIANCES, BoxCovariance
from coopsim.localization.odometry import OdometryFrame, stated_poses
from coopsim.support.checks import require_choice, require_flag
from coopsim.support.methods import WeakMethod
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.delayed import DELAYED, RECEIVER, DelayedMeasurements, Fusion, Measurements
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec, Detections, Message, Observation, Tracks
from coopsim.types.groups import DetectionGroups
from coopsim.types.valid_detections import FARTHEST_M, drop_unreportable

if TYPE_CHECKING:
    from coopsim.interfaces.defense import DefenseOption


@dataclass
class _AgentState:
    fuse: Fusion
    is_object: bool
    frame_owner: str | None
    alignment: PoseAlignment | None
    covariance: BoxCovariance | None
    frame: OdometryFrame = field(default_factory=OdometryFrame)
    tracks: DelayedMeasurements = field(init=False)
    fused: Sequence[Detections] = ()

    def fuse_and_remember(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        """Return the fused groups of one moment. Moments are fused in order of time, so the last stays."""
        self.fused = self.fuse(groups)
        return self.fused


@dataclass(kw_only=True, eq=False)
class TrackingPolicy(Policy):
    """A tracker of the agent's own detections and, if `needs.uplink` is "detections", those of all senders.

    Tracks are kept in the odometry frame, in which standing objects stand still and whose drift is slow, so that noise
    of the global pose reaches a track only through messages. A received box is moved there by the *estimated* poses of
    its sender, at capture, and of the receiver, now.

    Subclasses are keyword-only dataclasses: their fields are the policy's parameters.

    Attributes:
        delayed: treatment of delayed messages: "as_current", "predict" or "replay" (see
            `coopsim.tracking.delayed`).
        align: correct the senders' poses by the objects that several agents see (see `coopsim.fusion.alignment`).
        covariance: name or path of the weights of a network, such as "dmstrack", whose covariances of boxes replace the
            detectors' before boxes are fused and tracked; None: the detectors'.
        velocities: send boxes with velocities, by a tracker of each sender's own, 4 bytes each. Late boxes are moved by
            them; without them, by the receiver's tracker of each sender.
        intents: send the planned ways and hard brakes of cars beside boxes, see `ShareIntents`. Planners use them.
        defense: judge of the senders, such as "plausibility" (see `coopsim.defenses`); None: all are believed.
    """

    delayed: str = "predict"
    align: bool = False
    covariance: str | None = None
    velocities: bool = False
    intents: bool = False
    defense: DefenseOption = None

    def __post_init__(self) -> None:
        require_flag(align=self.align, velocities=self.velocities, intents=self.intents)
        for name in ("velocities", "intents"):
            if getattr(self, name) and self.needs.uplink != "detections":
                raise InvalidValueError(
                    f"{name} must be False for a policy that shares no boxes, got True: it shares {self.needs.uplink}"
                )
        DELAYED.get(self.delayed)
        self._covariance = None if self.covariance is None else COVARIANCES.get("weights")(self.covariance)
        self._states: dict[str, _AgentState] = {}
        self._load()
        self.defend(self.defense)
        self.make_tracker()  # so that a wrong setting is refused here, not at the first episode

    def _load(self) -> None:
        """Make the networks of a policy that has any; they decide what it needs."""

    @abstractmethod
    def make_tracker(self) -> Tracker | TrackersByClass:
        """Return a new tracker, for one agent and one episode."""

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        """Turn one moment's detections, a group per agent, into the groups that update the tracks one after another.

        The first group is the receiver's or, in a recording, that of the agent whose frame it is. By default each
        agent's own group updates the tracks. The groups come as `DetectionGroups`, so a fusion of many agents may work
        on `groups.joined`.
        """
        return groups

    def perceive(self, agent: str, observation: Observation) -> Detections:
        """Return what `agent` detects now, in its base frame: by default its detector's detections.

        Override it in a policy with detections of its own, from points or fused features for example: odometry frame,
        delayed messages, alignment and tracker are inherited. Messages are in `observation.inbox`, see `read`.
        """
        return observation.detections

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if self.intents:
            return ShareIntents(spec.codec or "detections", self.velocities)
        if self.velocities:
            return ShareDetections(spec.codec or "detections", velocities=True)
        return super().make_uplink(spec, rng)

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        first = RECEIVER if spec.frame_owner in (None, spec.name) else spec.frame_owner
        alignment = PoseAlignment.of(self.specs, spec.name) if self.align else None
        state = self._states[spec.name] = _AgentState(
            WeakMethod(self.fuse), spec.is_object, spec.frame_owner, alignment, self._covariance
        )
        make, fuse = WeakMethod(self.make_tracker), WeakMethod(state.fuse_and_remember)
        state.tracks = DELAYED.get(self.delayed)(make, fuse, first)

    def track(self, agent: str, observation: Observation) -> Tracks:
        self._states[agent].frame.move(observation)
        return self._track(agent, observation, self.perceive(agent, observation))

    def _track(self, agent: str, observation: Observation, found: Detections) -> Tracks:
        """Return the tracks for what the agent itself detects; its frame is moved already."""
        state, own = self._states[agent], drop_unreportable(found)
        odom_SE3_base = state.frame.odom_SE3_base
        reads = self.needs.uplink == "detections"
        received = self.read(agent, nearby_messages(observation), _decode_reportable) if reads else []
        # In the order in which they are tracked: then groups that are joined here need not be sorted later.
        received.sort(key=lambda each: each[0].sender)
        if self.guard is not None and reads:
            masks = self.guard.judge_boxes(observation, agent, state.frame, received, own)
            received = [(message, boxes[mask]) for (message, boxes), mask in zip(received, masks, strict=True)]
        measured = _measurements(agent, own, received, observation, state, state.alignment if reads else None)
        return state.tracks.step(measured, observation.time_ns).transform(odom_SE3_base.inverse())

    def detections(self, agent: str) -> Detections:
        """Return the detections that updated the agent's tracks last, in its base frame; none before its first frame.

        They are the result of `perceive` and `fuse` for the newest moment: of a late fusion the merged boxes, of a
        fusion of features the network's detections.

        Raises:
            UnknownNameError: there is no such agent in the running episode.
        """
        require_choice("agent", agent, self._states)
        state = self._states[agent]
        return Detections.concatenate(state.fused).transform(state.frame.odom_SE3_base.inverse())


P = TypeVar("P", bound=TrackingPolicy)


@dataclass_transform(kw_only_default=True, eq_default=False)
def policy_row(name: str, *, alias: str | None = None, weights: str | None = None) -> Callable[[type[P]], type[P]]:
    """Return a decorator that makes a class a keyword-only dataclass, and the policy called `name`.

    A class that differs from its base in nothing but its `method` and, maybe, its default `weights`, is a row of these.
    """

    def register(kind: type[P]) -> type[P]:
        if weights is not None:
            kind.__annotations__ = {**kind.__annotations__, "weights": "str"}
            setattr(kind, "weights", weights)  # noqa: B010  (not every policy has weights)
        made = dataclass(kw_only=True, eq=False)(kind)
        POLICIES.register(name, alias=alias)(made)
        return made

    return register


def _decode_reportable(message: Message) -> Detections:
    """Return the detections in a message that a report can name; a pure function, as `Policy.read` wants."""
    return drop_unreportable(decode_detections(message))


def _measurements(
    agent: str,
    own: Detections,
    received: Sequence[tuple[Message, Detections]],
    observation: Observation,
    state: _AgentState,
    alignment: PoseAlignment | None,
) -> Measurements:
    """Return the receiver's own boxes and those of each message, in the odometry frame, less those on the receiver
    itself.

    A policy that reads messages elsewhere places them by its alignment there, once in each frame, and gives none here.
    """
    frame, messages = state.frame, [message for message, _ in received]
    captured_ns = [observation.time_ns, *(message.captured_ns for message in messages)]
    if alignment is None:
        senders = frame.odom_SE3_senders(messages, observation)
    else:
        placed = own.transform(frame.odom_SE3_base)
        senders = SE3Batch.of(alignment.place(observation, frame, placed, received))
    groups = DetectionGroups.of([own, *(found for _, found in received)])
    sensors = senders.with_first(frame.odom_SE3_base)
    groups = groups.transform_each(sensors)
    if state.is_object and messages:
        over = covers(groups.joined.boxes, frame.positions_at(captured_ns)[groups.group, :2])
        over[: len(own)] = False
        groups = groups.keep(~over)
    if state.covariance is not None:
        sources = [agent, *(message.sender for message in messages)]
        known = np.array([state.frame_owner in (None, source) for source in sources])
        groups = state.covariance.apply(groups, frame.odom_SE3_base, sensors, known)
    return Measurements([RECEIVER, *(message.sender for message in messages)], captured_ns, groups)


def nearby_messages(observation: Observation) -> list[Message]:
    """Return the messages with a stated sender pose within `FARTHEST_M` of the receiver."""
    if not observation.inbox:
        return []
    away_m = stated_poses(observation.inbox)[:, :3] - observation.pose.xyz_yaw[:3]
    farthest_m: Floats = np.abs(away_m).max(axis=1)
    return list(compress(observation.inbox, (farthest_m <= FARTHEST_M).tolist()))
