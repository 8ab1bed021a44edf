"""The networks of one agent at work on clouds of points, of its own or of several agents: to detections."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from coopsim.localization.recent_sweeps import Points, turned
from coopsim.nn.camera.picture_batch import PictureView, SeenPicture, collate_pictures
from coopsim.nn.camera.picture_detector import PointsAndPicturesNet
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.inference.inference import inference, side_by_side
from coopsim.nn.inference.perceiver import compass_region
from coopsim.nn.inference.quick import QuickEncoder, folded
from coopsim.nn.inference.quick_pictures import QuickBothEncoder
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


class CloudAndPicturesDetector:
    """A `PointsAndPicturesNet` that looks for objects in a cloud of points, of one agent or several, and in pictures.

    Args:
        net: the network.
    """

    def __init__(self, net: PointsAndPicturesNet) -> None:
        self._encoder, self._head = QuickBothEncoder(net.encoder), folded(net.head)
        self._cell_m = STRIDE * net.config.pictures.cell_m

    def detect(
        self,
        points: Points,
        pictures: Sequence[SeenPicture],
        region_m: tuple[float, float],
        heading_rad: float,
        least_score: float,
    ) -> Detections:
        """Return the detections in points (P, 5) and in an agent's pictures; see `CloudDetector.detect`.

        All points measure depths in the pictures: those of other agents, too.
        """
        region = compass_region(region_m, heading_rad, self._cell_m)
        canvas = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        pose = np.array([0.0, 0.0, heading_rad])
        seen = PictureView(pictures, pose, canvas, points_m=turned(points, -heading_rad)[:, :3])
        with inference():
            features = self._encoder(collate([pillarize(points, canvas)]), collate_pictures([seen]))
            return decode(self._head, features, region, least_score=least_score)[0]
