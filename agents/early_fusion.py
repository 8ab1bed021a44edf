"""Early fusion: agents share points, and each receiver's network sees all of them at once.

Cooper (Chen et al., "Cooper: Cooperative Perception for Connected Autonomous Vehicles based on 3D Point Clouds", ICDCS
2019), and the upper bound in the tables of OPV2V and V2XSet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from coopsim.agents.perceiving_policy import PerceivingPolicy, Received
from coopsim.agents.policy import Needs
from coopsim.agents.tracking_policy import policy_row
from coopsim.comms.envelope import decode_points
from coopsim.comms.uplinks.share_points import SharePoints
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import CodecError
from coopsim.localization.odometry import Points, RecentSweeps, aged, turned
from coopsim.support.checks import require_choice
from coopsim.types import AgentSpec, Detections, Message, Observation, PointCloud, SensorView

if TYPE_CHECKING:
    from coopsim.nn.camera.picture_batch import SeenPicture

_KEEP_LOW = 0.1
"""Share of the points near the ground that are sent: the network needs to know where the ground is, and no more."""


_NEEDS = {
    "points": Needs(uplink="points", lidar=True),
    "both": Needs(uplink="points", lidar=True, cameras="surround", any_rig=True),
}
"""Requirements on the agents, by `sensors`."""


@policy_row("early", alias="concat")
class EarlyFusion(PerceivingPolicy):
    """The points of all agents, found in by one network. Further parameters: `PerceivingPolicy`.

    Unlike in Cooper, points are sent in the sender's frame and placed by the receiver, and of points near the ground
    one in ten is sent. With AB3DMOT behind it, as usual, it is the row "Concat" of Hu, Wang and Wang ("Integrated
    Detection and Tracking Framework for 3D Multi-Object Tracking in Vehicle-Infrastructure Cooperation", Table I).

    Attributes:
        sensors: the receiver's input, "points" or "both": all points together with its own pictures, in which the
            points of all agents measure depths (DINO-CoDT's depth mask).
        picture_weights: name or path of the weights of the network on both.
    """

    needs = _NEEDS["points"]
    method = "Cooper (Chen et al., 2019): points of all, one network of coopsim's"

    weights: str = "early"
    sensors: str = "points"
    picture_weights: str = "points_and_pictures"

    def load(self) -> None:
        require_choice("sensors", self.sensors, _NEEDS)
        self.needs = _NEEDS[self.sensors]
        from coopsim.learn.weights import load_detector, load_points_and_pictures
        from coopsim.nn.inference.detectors import CloudAndPicturesDetector, CloudDetector

        self._own: dict[str, Points] = {}
        self._pictures: dict[str, list[SeenPicture]] = {}
        if self.sensors == "both":
            both = CloudAndPicturesDetector(load_points_and_pictures(self.picture_weights), self._backend)
            self._sweeps, self._detect = RecentSweeps(1), both.detect
            return
        clouds = CloudDetector(load_detector(self.weights), self._backend)
        self._sweeps = RecentSweeps(clouds.sweeps)
        self._detect = lambda points, _, *more: clouds.detect(points, *more)

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        return SharePoints(codec=spec.codec or "points", keep_low=_KEEP_LOW)

    def prepare(self, observations: Mapping[str, Observation]) -> None:
        for agent, observation in observations.items():
            if observation.sensed:
                view = observation.view(self.specs[agent])
                self._own[agent] = turned(self._sweeps.points(view), float(observation.pose.xyz_yaw[3]))
                self._pictures[agent] = self._pictures_of(view)

    def decode(self, message: Message) -> PointCloud:
        cloud = decode_points(message)
        if not cloud.extent_m <= 1e5:
            raise CodecError(f"points must be within 100 km of their sender, got one at {cloud.extent_m:g} m")
        return cloud

    def find(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        heading_rad = float(observation.pose.xyz_yaw[3])
        clouds = [self._own[agent]]
        clouds += [aged(each.content.transform(self.compass_SE3_sender(agent, observation, each))) for each in received]
        points, pictures = np.concatenate(clouds), self._pictures[agent]
        return self._detect(points, pictures, self.region_m, heading_rad, self.least_score)

    def found_by(self, heading_rad: float, content: PointCloud) -> Detections:
        reach = max(self.region_m)
        return self._detect(aged(content), [], (reach, reach), 0.0, self.least_score)

    def _pictures_of(self, view: SensorView) -> list[SeenPicture]:
        if self.sensors == "points":
            return []
        from coopsim.nn.inference.encoders import pictures_of

        return pictures_of(view)
