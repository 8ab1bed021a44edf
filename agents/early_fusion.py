"""Early fusion: agents share points, and each receiver's network sees all of them at once.

Cooper (Chen et al., "Cooper: Cooperative Perception for Connected Autonomous Vehicles based on 3D Point Clouds", ICDCS
2019), and the upper bound in the tables of OPV2V and V2XSet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.agents.perceiving_policy import Heard, PerceivingPolicy
from coopsim.agents.policy import Needs
from coopsim.catalog import POLICIES
from coopsim.comms.envelope import decode_points
from coopsim.comms.uplinks.share_points import SharePoints
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import CodecError
from coopsim.localization.recent_sweeps import Points, RecentSweeps, aged, turned
from coopsim.types import AgentSpec, Detections, Message, Observation, PointCloud

_KEEP_LOW = 0.1
"""Share of the points near the ground that are sent: the network needs to know where the ground is, and no more."""


@POLICIES.register("early")
@dataclass(kw_only=True, eq=False)
class EarlyFusion(PerceivingPolicy):
    """The points of all agents, found in by one network. Parameters: `PerceivingPolicy`.

    Unlike in Cooper, points are sent in the sender's frame and placed by the receiver, and of points near the ground
    one in ten is sent.
    """

    needs = Needs(uplink="points", lidar=True)

    weights: str = "early"

    def load(self) -> None:
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.weights import load_detector
        from coopsim.nn.inference.cloud_detector import CloudDetector

        self._detector = CloudDetector(load_detector(self.weights))
        self._sweeps = RecentSweeps(self._detector.sweeps)
        self._own: dict[str, Points] = {}

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        return SharePoints(codec=spec.codec or "points", keep_low=_KEEP_LOW)

    def prepare(self, observations: Mapping[str, Observation]) -> None:
        for agent, observation in observations.items():
            if observation.sensed:
                points = self._sweeps.points(observation.view(self.specs[agent]))
                self._own[agent] = turned(points, float(observation.pose.xyz_yaw[3]))

    def decode(self, message: Message) -> PointCloud:
        cloud = decode_points(message)
        if not cloud.extent_m <= 1e5:
            raise CodecError(f"points must be within 100 km of their sender, got one at {cloud.extent_m:g} m")
        return cloud

    def find(self, agent: str, observation: Observation, heard: Sequence[Heard]) -> Detections:
        heading_rad = float(observation.pose.xyz_yaw[3])
        clouds = [self._own[agent]]
        clouds += [aged(each.content.transform(self.compass_SE3_sender(agent, observation, each))) for each in heard]
        return self._detector.detect(np.concatenate(clouds), self.region_m, heading_rad, self.least_score)

    def found_by(self, heading_rad: float, content: PointCloud) -> Detections:
        reach = max(self.region_m)
        return self._detector.detect(aged(content), (reach, reach), 0.0, self.least_score)
