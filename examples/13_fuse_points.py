"""Early fusion: agents broadcast their points, and each receiver finds objects in its own and all others' together."""

import numpy as np
from scipy import ndimage

import coopsim
from coopsim.agents.boxes import AB3DMOTTracking
from coopsim.comms.envelope import decode_points
from coopsim.geometry.boxes import Boxes3D
from coopsim.testing import check_policy
from coopsim.types import Detections, ObjectClass, Observation, PointCloud

CAR_M = np.array([3.5, 1.7, 1.5])


def clusters(xyz: np.ndarray) -> Detections:
    """Return a box around each cluster of points above the ground: cells of half a metre that touch are one object."""
    xyz = xyz[(xyz[:, 2] > 0.4) & (xyz[:, 2] < 4) & (np.abs(xyz[:, :2]) < 50).all(axis=1)]
    cell = tuple((2 * xyz[:, :2] + 100).astype(int).T)
    occupied = np.zeros((200, 200), dtype=bool)
    occupied[cell] = True
    cluster = ndimage.label(occupied, np.ones((3, 3)))[0][cell]
    members = [xyz[cluster == k] for k in np.unique(cluster)]
    members = [each for each in members if len(each) >= 5 and np.ptp(each[:, :2], axis=0).max() < 7]
    low, high = (np.array([end(each, axis=0) for each in members]).reshape(-1, 3) for end in (np.min, np.max))
    size = np.maximum(high - low, CAR_M)
    center = np.column_stack([(low + high)[:, :2] / 2, size[:, 2] / 2])
    score = np.array([1 - np.exp(-len(each) / 30) for each in members])
    return Detections(Boxes3D(center, size, np.zeros(len(size))), score, np.full(len(size), ObjectClass.CAR))


class EarlyFusion(AB3DMOTTracking):
    """AB3DMOT on clusters of all agents' points; only `perceive` is new, the tracker is inherited."""

    needs = coopsim.Needs(uplink="points", lidar=True)

    def perceive(self, agent: str, observation: Observation) -> Detections:
        base_SE3_world = observation.pose.world_SE3_base.inverse()
        clouds = [PointCloud.of(*observation.sweeps.values())]
        for message, cloud in self.read(agent, observation.inbox, decode_points):
            clouds.append(cloud.transform(base_SE3_world.compose(message.pose.world_SE3_base)))
        return clusters(PointCloud.concatenate(clouds).xyz)


class Alone(EarlyFusion):
    """The same without messages."""

    needs = coopsim.Needs(uplink="none", lidar=True)


check_policy(EarlyFusion)
options = {"seed": 1, "max_cycles": 20, "lidar": "OS1-128", "detector": "none"}
for policy, more in [(Alone(), {}), (EarlyFusion(), {}), (EarlyFusion(), {"codec": "voxels", "budget_bytes": 4000})]:
    score = coopsim.evaluate(policy, "highway", **options, **more).score
    name = type(policy).__name__ + (" in 4 kB" if more else "")
    print(f"{name:>19}: recall {score['recall']:.1f} %, {score['bytes_per_s'] / 1000:.0f} kB/s per agent")
