"""The network of one agent at work: from points to detections."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.inference.inference import inference, side_by_side
from coopsim.nn.inference.perceiver import compass_region
from coopsim.nn.inference.quick import QuickEncoder, folded
from coopsim.types import BevGrid, Detections


class CloudDetector:
    """A `DetectorNet` that looks for objects in clouds of points.

    Attributes:
        sweeps: number of sweeps that it was trained on.

    Args:
        net: the network.
        threads: clouds are looked at side by side on so many.
    """

    def __init__(self, net: DetectorNet, threads: int = 1) -> None:
        self._encoder, self._head = QuickEncoder(net.encoder), folded(net.head)
        self._cell_m, self._threads, self.sweeps = STRIDE * net.config.cell_m, threads, net.config.sweeps

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
        region = compass_region(region_m, heading_rad, self._cell_m)
        return self._detect(region, least_score, points)

    def detect_around(
        self, clouds: Sequence[NDArray[np.float32]], reach_m: float, least_score: float
    ) -> list[Detections]:
        """Return the detections in clouds (P, 5) of A agents, in a square of +-`reach_m` around each."""
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        return side_by_side([partial(self._detect, region, least_score, points) for points in clouds], self._threads)

    def _detect(self, region: BevGrid, least_score: float, points: NDArray[np.float32]) -> Detections:
        pillars = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        batch = collate([pillarize(points, pillars)])
        with inference():
            return decode(self._head, self._encoder(batch), region, least_score=least_score)[0]
