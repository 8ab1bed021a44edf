"""The base of policies that fuse feature maps: encode, share, warp, fuse, detect, track."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from coopsim.agents.perceiving_policy import PerceivingPolicy, Received
from coopsim.agents.policy import Needs
from coopsim.comms.envelope import decode_features
from coopsim.comms.uplinks.once_per_frame import EncodeOnce
from coopsim.comms.uplinks.share_features import ShareMaps
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_choice
from coopsim.types import (
    AgentSpec,
    BevGrid,
    Detections,
    FeatureMap,
    Message,
    Observation,
    SensorView,
    stack_xyz_yaw,
)

if TYPE_CHECKING:
    from torch import Tensor

    from coopsim.nn.cooperative.cooperative_net import CooperativeNet
    from coopsim.nn.cooperative.flow_sender import FlowSender
    from coopsim.nn.cooperative.perceiver import OwnMap, Perceiver, ReceivedMap
    from coopsim.nn.detector.detector_net import DetectorNet
    from coopsim.nn.inference.encoders import SensorEncoder

DENSE, SPARSE = "features(number=int8)", "sparse_features(most_cells=20000, number=int8)"
"""Codecs: all cells, and as many of the surest ones as a budget has room for."""
SURE, _MOST_DENSE = "sparse_features(most_cells=600, number=int8)", 16
"""Codec of messages with more channels than so many a cell: with 64, 41 kB, where all cells are 1.2 MB."""

_NEEDS = {
    "points": Needs(uplink="features", lidar=True),
    "pictures": Needs(uplink="features", cameras="surround", any_rig=True),
    "both": Needs(uplink="features", lidar=True, cameras="surround", any_rig=True),
    "mixed": Needs(uplink="features"),
}
"""Requirements on the agents, by `sensors`."""


@dataclass(kw_only=True, eq=False)
class LearnedFusion(PerceivingPolicy):
    """A policy that fuses the feature maps of all agents. Further parameters: `PerceivingPolicy`.

    Each agent encodes what its sensors gave once a frame, for itself and for the others. Maps of points and of pictures
    mean the same, so one fusion takes both, and agents with different sensors understand each other. Maps come
    compressed to a few channels, are warped to where their senders were, and expanded and fused there. `align`, the
    correction of poses by objects that several agents see, is then that of CoAlign (Lu et al., ICRA 2023).

    Networks with `told_errors`, such as those of 64 channels, are told how wrong a sender's place may be: by the
    covariances that agents state (`localization={"covariance_scale": 1.0}`), or by what `align` leaves. Without either
    these networks take poses to be exact.

    Attributes:
        detector_weights: name or path of the point encoder's weights; None: as the file of `weights` names them.
        sensors: input of the encoders, "points", "pictures", "both" together, or "mixed": each agent its points if it
            has a LiDAR, else its pictures. An agent with neither detects nothing by itself.
        picture_weights: name or path of the weights of the encoder of pictures, or of both, trained beside that of
            points; None: "points_and_pictures" for both, else "lift_splat".
        fusion: place of the class of the weights' fusion, where that is code of a user, such as "mine.py:MyFusion";
            None: the weights name a registered one.
    """

    needs = _NEEDS["points"]
    codec: ClassVar[str] = DENSE
    request_block: ClassVar[int] = 0

    detector_weights: str | None = None
    sensors: str = "points"
    picture_weights: str | None = None
    fusion: str | None = None

    def load(self) -> None:
        require_choice("sensors", self.sensors, _NEEDS)
        self.needs = _NEEDS[self.sensors]
        from coopsim.learn.weights import digest, load_detector_of
        from coopsim.nn.cooperative.perceiver import KINDS, Perceiver

        detector = load_detector_of(self.weights, self.detector_weights)
        net = self.load_net(detector)
        space = int(digest(self.weights)[:8], 16)
        self._kinds, self._perceiver = KINDS, Perceiver(net, detector.config.cell_m, space, self._backend)
        self._usual = SURE if net.message_channels > _MOST_DENSE and self.codec == DENSE else self.codec
        self._encoder = self.make_encoder(detector)
        self._flow = self.make_flow(net)
        # Without this policy in it: the uplink may outlive it, and what it holds itself must not keep it alive.
        encode = partial(_encoded, self._encoder, self._perceiver, self._flow)
        self._encode: EncodeOnce[OwnMap] = EncodeOnce(encode_all=encode)
        self._uplink: ShareMaps | None = None
        self._served: set[str] = set()

    def load_net(self, detector: DetectorNet) -> CooperativeNet:
        """Return the cooperative network of `weights`, for the features of a detector.

        Raises:
            UnknownNameError: there are no such weights.
            InvalidValueError: they are broken, of another kind, or were trained on another encoder.
        """
        from coopsim.learn.weights import load_cooperative

        return load_cooperative(self.weights, detector, self.fusion)

    def make_encoder(self, detector: DetectorNet) -> SensorEncoder:
        """Return the encoder of what agents' sensors give, by `sensors`; `detector` has that of points.

        Raises:
            UnknownNameError: there are no such weights for pictures.
            InvalidValueError: they are broken, or were trained beside another encoder.
        """
        from coopsim.learn.weights import load_pictures, load_points_and_pictures
        from coopsim.nn.inference.encoders import BothEncoder, MixedEncoder, PictureEncoder, PointEncoder

        if self.sensors == "points":
            return PointEncoder(detector, self._backend)
        if self.sensors == "both":
            both = load_points_and_pictures(self.picture_weights or "points_and_pictures", detector)
            return BothEncoder(both, self._backend)
        pictures = PictureEncoder(load_pictures(self.picture_weights or "lift_splat", detector), self._backend)
        return pictures if self.sensors == "pictures" else MixedEncoder(PointEncoder(detector, self._backend), pictures)

    def make_flow(self, net: CooperativeNet) -> FlowSender | None:
        """Return what adds to an agent's map how it changes, if the network has learned that; None: nothing does."""
        from coopsim.nn.cooperative.flow_sender import FlowSender

        return None if net.flow is None else FlowSender(net.flow, self._backend)

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if self._uplink is None or spec.name in self._served:  # an episode begins
            thrifty = SPARSE if spec.codec is None else None
            self._uplink = ShareMaps(self._encode, spec.codec or self._usual, thrifty, self.request_block)
            self._served = set()
        self._served.add(spec.name)
        return self._uplink

    def prepare(self, observations: Mapping[str, Observation]) -> None:
        sensed = {agent: each for agent, each in observations.items() if each.sensed}
        if self._flow is not None:
            for agent, each in observations.items():
                if not each.sensed:
                    self._flow.follow(agent, each.time_ns, each.odometry)
        self._encode.all([each.view(self.specs[agent]) for agent, each in sensed.items()])

    def decode(self, message: Message) -> ReceivedMap:
        return self._perceiver.receive(decode_features(message))

    def find(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        return self._perceiver.detect(*self.fused(agent, observation, received), self.least_score)

    def fused(self, agent: str, observation: Observation, received: Sequence[Received]) -> tuple[Tensor, BevGrid]:
        """Return the features (64, H, W) that an agent makes of its own map and what it received, and their cells."""
        from coopsim.nn.cooperative.perceiver import PlacedMap

        perceiver, pose = self._perceiver, observation.pose.xyz_yaw
        own = self._encode(observation.view(self.specs[agent]))
        region = perceiver.region(self.region_m, float(pose[3]), pose[:2])
        placed = [
            PlacedMap(
                each.content,
                self._sender_SE2_receiver(agent, observation, each),
                each.delay_s(observation.time_ns),
                self._kind(each.message.sender),
                self._error(agent, observation, each),
            )
            for each in received
        ]
        return perceiver.fuse(own, region, placed, self._kind(agent)), region

    def features(
        self, agent: str, observation: Observation, received: Sequence[Received], number: int
    ) -> FeatureMap | None:
        if number < 0:
            return self._encode(observation.view(self.specs[agent])).message
        content: ReceivedMap = received[number].content
        return content.content

    def heat(self, values: Tensor) -> Tensor:
        """Return the heat that a message's values alone show, for attackers who know the weights; see `Perceiver`."""
        return self._perceiver.heat(values)

    def found_by(self, heading_rad: float, content: ReceivedMap) -> Detections:
        found = self._perceiver.detect(self._perceiver.alone(content), content.content.grid, self.least_score)
        return found.transform(SE3.from_xyz_yaw(np.zeros(3), -heading_rad))

    def _sender_SE2_receiver(self, agent: str, observation: Observation, received: Received) -> Any:
        """Return the receiver's compass frame now in the sender's at capture, as (3,): x m, y m, yaw rad."""
        sender_SE3_compass = self.compass_SE3_sender(agent, observation, received).inverse()
        compass_SE3_sender = SE3.from_xyz_yaw(np.zeros(3), float(received.message.pose.xyz_yaw[3]))
        return stack_xyz_yaw(compass_SE3_sender.compose(sender_SE3_compass))[[0, 1, 3]]

    def _error(self, agent: str, observation: Observation, received: Received) -> tuple[float, float]:
        """Return the standard deviations of the place (m) and heading (rad) of a sender in the receiver's frame.

        They are what both state, or with `align` what the common objects leave of it.
        """
        alignment, message = self._states[agent].alignment, received.message
        left = None if alignment is None else alignment.covariance(message.sender)
        stated = [each.covariance for each in (observation.pose, message.pose)]
        return _deviations([each for each in (stated if left is None else [left]) if each is not None])

    def _kind(self, sender: str) -> int:
        return self._kinds.index(self.specs[sender].kind) if sender in self.specs else 0


def _deviations(covariances: Sequence[Floats]) -> tuple[float, float]:
    """Return the standard deviations of place (m) and heading (rad) of a sum of errors; without any, 0."""
    if not covariances:
        return 0.0, 0.0
    variance = np.maximum(np.diagonal(np.sum(covariances, axis=0)), 0.0)
    return float(np.sqrt(variance[:2].mean())), float(np.sqrt(variance[2]))


def _encoded(
    encoder: SensorEncoder, perceiver: Perceiver, flow: FlowSender | None, views: Mapping[str, SensorView]
) -> dict[str, OwnMap]:
    """Return the maps of several agents, made side by side."""
    frames = [encoder.take(view) for view in views.values()]
    maps = dict(zip(views, perceiver.encode(frames), strict=True))
    return maps if flow is None else flow.add(views, maps)
