"""Bring an intermediate-fusion network of your own: encoder, features as messages, fuse, head, device."""

import numpy as np

try:
    import torch
    from torch import nn
except ImportError:
    print("this example needs torch: pip install 'coopsim[learn]'")
    raise SystemExit(0) from None

import coopsim
from coopsim.agents import AB3DMOTTracking
from coopsim.comms import EncodeOnce, ShareFeatures, decode_features
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import BevGrid, Detections, FeatureMap, ObjectClass

GRID = BevGrid(x_m=(-51.2, 51.2), y_m=(-25.6, 25.6), cell_m=0.8)


class MyNetwork(AB3DMOTTracking):
    """Points above the ground in cells, a convolution, the maximum over agents, and a head of boxes."""

    needs = coopsim.Needs(uplink="features", lidar=True)

    def __init__(self, device: str = "cpu", least_score: float = 0.6) -> None:
        super().__init__(hits=1)
        torch.manual_seed(0)  # yours: load_state_dict
        self.device, self.least_score = device, least_score
        self.encoder = nn.Sequential(nn.Conv2d(1, 8, 3, padding=1), nn.ReLU()).to(device).eval()
        self.head = nn.Conv2d(8, 8, 1).to(device).eval()  # score, then offsets of x, y, z, l, w, h and yaw
        self.encode = EncodeOnce(self.features)  # once a frame, for its own message and its own boxes

    def features(self, view) -> FeatureMap:
        points = np.concatenate([sweep.points for sweep in view.sweeps.values()])
        points = points[points[:, 2] > 0.4]
        edges = [np.linspace(*span, n + 1) for span, n in zip((GRID.y_m, GRID.x_m), GRID.shape, strict=True)]
        counts = np.histogram2d(points[:, 1], points[:, 0], edges)[0]
        with torch.no_grad():
            maps = self.encoder(torch.tensor(np.log1p(counts), dtype=torch.float32, device=self.device)[None, None])
        return FeatureMap(maps[0].cpu().numpy(), GRID, confidence=1 - np.exp(-counts))

    def make_uplink(self, spec, rng) -> ShareFeatures:
        return ShareFeatures(self.encode, spec.codec or "sparse_features(most_cells=1000)")

    def perceive(self, agent, observation) -> Detections:
        maps = [self.encode(observation.view(self.specs[agent])).values]
        base_SE3_world = observation.pose.world_SE3_base.inverse()
        for message, features in self.read(agent, observation.inbox, decode_features):
            warped, covered = features.warp(GRID, base_SE3_world.compose(message.pose.world_SE3_base))
            maps.append(np.where(covered, warped.values, 0.0))
        with torch.no_grad():
            fused = torch.tensor(np.array(maps), dtype=torch.float32, device=self.device).amax(dim=0)  # F-Cooper's
            out = self.head(fused[None])[0].cpu().numpy()
        score = 1 / (1 + np.exp(-out[0]))
        rows, columns = np.nonzero(score >= self.least_score)
        x, y = (span[0] + GRID.cell_m * (i + 0.5) for span, i in ((GRID.x_m, columns), (GRID.y_m, rows)))
        offsets = out[1:, rows, columns].T
        boxes = (
            np.column_stack([x, y, np.full(len(x), 0.8), np.tile([4.5, 1.9, 1.6, 0.0], (len(x), 1))]) + 0.1 * offsets
        )
        return Detections(Boxes3D.from_array(boxes), score[rows, columns], np.full(len(x), ObjectClass.CAR))


if __name__ == "__main__":
    env = coopsim.parallel_env("crossing", uplink=(policy := MyNetwork()), lidar="HDL-32E", max_cycles=3)
    coopsim.run_episode(env, policy, seed=0)
    print(f"{env.score()['bytes_per_s']:.0f} bytes/s per agent, {policy.rejected.total()} messages rejected")
    # Its row: coopsim detect --policies no_fusion,examples/24_bring_your_network.py:MyNetwork --device auto
