"""The network of one agent at work: from points to detections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.nn.decode import decode
from coopsim.nn.detector_net import DetectorNet
from coopsim.nn.encoder import STRIDE
from coopsim.nn.inference import inference
from coopsim.nn.perceiver import compass_region
from coopsim.nn.pillars import collate, pillarize
from coopsim.types import BevGrid, Detections


class CloudDetector:
    """A `DetectorNet` that looks for objects in clouds of points.

    Attributes:
        sweeps: number of sweeps that it was trained on.

    Args:
        net: the network.
        threads: of torch.
    """

    def __init__(self, net: DetectorNet, threads: int = 1) -> None:
        self._net, self._threads, self.sweeps = net, threads, net.config.sweeps

    def detect(
        self, points: NDArray[np.float32], region_m: tuple[float, float], heading_rad: float, least_score: float
    ) -> Detections:
        """Return the detections in points (P, 5), in a region of the base frame and in the points' axes.

        Args:
            points: in axes in which the agent's heading is `heading_rad`.
            region_m: |x| and |y| at most, in the base frame; see `compass_region`.
            heading_rad: the heading.
            least_score: smallest score of a detection.
        """
        region = compass_region(region_m, heading_rad, STRIDE * self._net.config.cell_m)
        return self._detect([points], region, least_score)[0]

    def detect_around(
        self, clouds: Sequence[NDArray[np.float32]], reach_m: float, least_score: float
    ) -> list[Detections]:
        """Return the detections in clouds (P, 5) of A agents, in a square of +-`reach_m` around each, in one batch."""
        region = compass_region((reach_m, reach_m), 0.0, STRIDE * self._net.config.cell_m)
        return self._detect(clouds, region, least_score) if clouds else []

    def _detect(self, clouds: Sequence[NDArray[np.float32]], region: BevGrid, least_score: float) -> list[Detections]:
        pillars = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        batch = collate([pillarize(points, pillars) for points in clouds])
        with inference(self._threads):
            features = self._net.encoder(batch)
            return decode(self._net.head, features, region, least_score=least_score)
