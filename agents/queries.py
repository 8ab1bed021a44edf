"""Policies that exchange instance queries: CoopTrack and UniV2X's fusion of agents."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from coopsim.agents.perceiving_policy import FrameChain, PerceivingPolicy, Received, base_SE3_compass
from coopsim.agents.policy import Needs
from coopsim.agents.tracking_policy import policy_row
from coopsim.comms.envelope import decode_queries
from coopsim.comms.uplinks.once_per_frame import EncodeOnce, StepOnce
from coopsim.comms.uplinks.share_features import ShareInstances
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.geometry.se3 import SE3, Floats
from coopsim.localization.odometry import OdometryFrame
from coopsim.support.checks import require_between, require_probability
from coopsim.support.methods import WeakMethod
from coopsim.types import AgentSpec, BevGrid, Detections, InstanceQueries, Message, Observation, SensorView, Tracks
from coopsim.types.valid_detections import drop_unreportable

if TYPE_CHECKING:
    from torch import Tensor

    from coopsim.nn.queries.cooptrack_fusion import ReceivedInstances
    from coopsim.nn.queries.instances import Instances
    from coopsim.nn.queries.perceiver import QueryState
    from coopsim.nn.queries.query_net import SeenMap


BY_QUERIES = "queries"
"""The tracker for which the numbers of instances are the ids of tracks."""


@dataclass
class _OwnChain:
    """Instances of an agent by itself, frame after frame."""

    frame: OdometryFrame = field(default_factory=OdometryFrame)
    memory: QueryState | None = None


@dataclass(kw_only=True, eq=False)
class QueryPolicy(PerceivingPolicy):
    """Base of policies whose agents keep instances from frame to frame and send them.

    A class's `fusion` names the way agents cooperate (see `coopsim.nn.queries.query_net.FUSIONS`). Each agent keeps two
    sets of instances: its own, which it sends, and the fused one, which it reports; so no echo comes back. Senders are
    fused from the nearest to the farthest: neither names nor the order of messages matter. Further parameters:
    `PerceivingPolicy`.

    Attributes:
        detector_weights: name or path of the weights of encoder and head; None: as the file of `weights` names them.
        tracker: "queries": an instance keeps its number while it is carried over, which is the track's id; or a policy
            that tracks boxes, whose tracker then follows what is found in each frame.
        least_reported: with the tracker "queries", smallest score of a reported track.
        least_shared: smallest score of an instance that is sent.
        least_affinity: smallest affinity of two instances that become one, in [0, 1]; above 1 none do.
    """

    needs = Needs(uplink="queries", lidar=True)
    fusion: ClassVar[str]
    codec: ClassVar[str] = "queries"
    own_tracker = BY_QUERIES

    tracker: str = BY_QUERIES
    detector_weights: str | None = None
    least_reported: float = 0.3
    least_shared: float = 0.2
    least_affinity: float = 0.5

    def __post_init__(self) -> None:
        require_probability(least_reported=self.least_reported, least_shared=self.least_shared)
        require_between(0, 2, least_affinity=self.least_affinity)
        super().__post_init__()

    def load(self) -> None:
        from coopsim.learn.weights import digest, load_detector_of, load_queries
        from coopsim.nn.inference.encoders import PointEncoder
        from coopsim.nn.queries.perceiver import QueryPerceiver

        detector = load_detector_of(self.weights, self.detector_weights)
        net = load_queries(self.weights, detector, self.fusion)
        self._perceiver = QueryPerceiver(net, detector, int(digest(self.weights)[:8], 16), self._backend)
        self._encoder = PointEncoder(detector, self._backend)
        self._see: EncodeOnce[SeenMap] = EncodeOnce(encode_all=WeakMethod(self._seen))
        self._own: dict[str, StepOnce[_OwnChain, Instances]] = {}
        # By a weak reference: the uplink holds this policy.
        self._uplink: Callable[[], ShareInstances | None] = lambda: None
        self._sending: dict[str, AgentSpec] = {}
        self._chains: dict[str, FrameChain[QueryState]] = {}  # of what agents know with the help of others

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        uplink = self._uplink()
        if uplink is None or spec.name in self._sending:  # an episode begins
            uplink, self._sending = ShareInstances(self._shared, spec.codec or self.codec), {}
            self._uplink = weakref.ref(uplink)
        self._sending[spec.name] = spec
        self._alone(spec.name).begin_sending(spec.name)
        return uplink

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        super().begin(spec, rng)
        self._alone(spec.name).begin(spec.name)
        self._chains[spec.name] = FrameChain()

    def prepare(self, observations: Mapping[str, Observation]) -> None:
        sensed = {agent: each for agent, each in observations.items() if each.sensed}
        self._see.all([each.view(self.specs[agent]) for agent, each in sensed.items()])
        for agent in self._sending:
            if agent in observations:  # frames in which it sends nothing, too
                self._alone(agent)(agent, observations[agent])

    def decode(self, message: Message) -> Instances:
        return self._perceiver.receive(decode_queries(message))

    def find(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        chain, now_ns = self._chains[agent], observation.time_ns
        before = chain.begin(now_ns)
        region = self._region(observation)
        placed = [self._placed(agent, observation, each, region) for each in received]
        placed.sort(key=lambda each: float(np.abs(each.receiver_SE3_sender.translation).max()))
        chain.now = self._perceiver.step(
            before, now_ns, self.odom_SE3_compass(agent, observation),
            self._see(observation.view(self.specs[agent])), placed, self.least_affinity,
        )  # fmt: skip
        return self._reported(chain.now.instances, region)

    def shown(
        self, content: InstanceQueries, vectors: Tensor, heading_rad: float, offset_m: Floats
    ) -> tuple[Tensor, Tensor]:
        """Return what a message alone shows, for attackers who know the weights; see `QueryPerceiver`."""
        return self._perceiver.shown(content, vectors, heading_rad, offset_m)

    def found_by(self, heading_rad: float, content: Instances) -> Detections:
        from coopsim.nn.queries.perceiver import detections_of

        return detections_of(content)

    def _follow(self, agent: str, observation: Observation, found: Detections) -> Tracks:
        from coopsim.nn.queries.perceiver import tracks_of

        if self.tracker != BY_QUERIES:
            return super()._follow(agent, observation, found)
        state, chain, now_ns = self._states[agent], self._chains[agent], observation.time_ns
        known, to_base = self._perceiver.nothing(), base_SE3_compass(observation)
        if chain.now is not None:
            known = chain.now.instances
        if chain.now is not None and not observation.sensed:
            known = chain.now.at(now_ns, self.odom_SE3_compass(agent, observation))
            placed = self._reported(known, self._region(observation)).transform(to_base)
            found = self._less_itself(agent, now_ns, [], placed)
        own = drop_unreportable(found)
        state.fused = [replace(own, embedding=None).transform(state.frame.odom_SE3_base)]
        return tracks_of(known, own[own.score >= self.least_reported], to_base)

    def _reported(self, known: Instances, region: BevGrid) -> Detections:
        """Return the instances in a region as detections, each with its row as the one number of its embedding.

        With another tracker, which might take it for looks, without.
        """
        from coopsim.nn.queries.perceiver import detections_of

        found = detections_of(known)
        if self.tracker == BY_QUERIES:
            found = replace(found, embedding=np.arange(len(found), dtype=np.float64)[:, None])
        x, y = found.boxes.center[:, 0], found.boxes.center[:, 1]
        inside = (region.x_m[0] <= x) & (x <= region.x_m[1]) & (region.y_m[0] <= y) & (y <= region.y_m[1])
        return found[inside & (found.score >= self.least_score)]

    def _region(self, observation: Observation) -> BevGrid:
        pose = observation.pose.xyz_yaw
        return self._perceiver.region(self.region_m, float(pose[3]), pose[:2])

    def _placed(self, agent: str, observation: Observation, received: Received, region: BevGrid) -> ReceivedInstances:
        """Return what a sender sent, in its compass frame, and the place of that in the receiver's."""
        compass_SE3_base = SE3.from_xyz_yaw(np.zeros(3), float(received.message.pose.xyz_yaw[3]))
        compass_SE3_compass = self.compass_SE3_sender(agent, observation, received).compose(compass_SE3_base.inverse())
        known = received.content.moved(compass_SE3_base)
        return self._perceiver.placed(known, compass_SE3_compass, received.delay_s(observation.time_ns), region)

    def _alone(self, agent: str) -> StepOnce[_OwnChain, Instances]:
        """Return what steps an agent's own mind, once a frame."""
        if agent not in self._own:
            self._own[agent] = StepOnce(_OwnChain, partial(WeakMethod(self._step_alone), agent))
        return self._own[agent]

    def _step_alone(self, agent: str, chain: _OwnChain, observation: Observation) -> Instances:
        """Return what an agent knows by itself after a frame, in its compass frame."""
        chain.frame.move(observation)
        if observation.sensed:
            odom_SE3_compass = chain.frame.odom_SE3_base.compose(base_SE3_compass(observation))
            seen = self._see(observation.view(self._sending[agent]))
            chain.memory = self._perceiver.step(chain.memory, observation.time_ns, odom_SE3_compass, seen)
        return self._perceiver.nothing() if chain.memory is None else chain.memory.instances

    def _shared(self, observations: Mapping[str, Observation]) -> dict[str, InstanceQueries]:
        """Return what agents send."""
        self._see.all([each.view(self._sending[agent]) for agent, each in observations.items()])
        tasks = [partial(self._alone(agent), agent, each) for agent, each in observations.items()]
        known = self._backend.side_by_side(tasks)
        return {
            agent: self._perceiver.message(each[each.score >= self.least_shared], float(observation.pose.xyz_yaw[3]))
            for (agent, observation), each in zip(observations.items(), known, strict=True)
        }

    def _seen(self, views: Mapping[str, SensorView]) -> dict[str, SeenMap]:
        """Return what several agents see, computed side by side."""
        frames = [self._encoder.take(view) for view in views.values()]
        return dict(zip(views, self._perceiver.see(frames), strict=True))


@policy_row("cooptrack", weights="cooptrack")
class CoopTrack(QueryPolicy):
    """Instances fused after decoding: aligned in two ways, matched by a graph, aggregated (Zhong et al., "CoopTrack:
    Exploring End-to-End Learning for Efficient Cooperative Sequential Perception", ICCV 2025).

    Unlike there, agents have LiDARs, any number of them take part, and the threshold can close. Parameters:
    `QueryPolicy`.
    """

    method = "CoopTrack (Zhong et al., ICCV 2025), on LiDARs, for any number of agents"
    fusion: ClassVar[str] = "cooptrack"


@policy_row("univ2x", weights="univ2x")
class UniV2X(QueryPolicy):
    """Queries fused before decoding: matched by distance within the box's size, and added (Yu et al., "End-to-End
    Autonomous Driving through V2X Cooperation", AAAI 2025). Parameters: `QueryPolicy`.

    Unlike there, agents have LiDARs, any number of them take part, and the network of one agent is that of CoopTrack:
    what differs between the two is how agents cooperate. `least_affinity` matters only above 1: then none are matched.
    """

    method = "UniV2X's fusion of agents (Yu et al., AAAI 2025), on CoopTrack's network of one agent"
    fusion: ClassVar[str] = "univ2x"
