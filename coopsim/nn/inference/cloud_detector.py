"""The networks of one agent at work on clouds of points, of its own or of several agents: to detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.localization.recent_sweeps import Points, turned
from coopsim.nn.camera.picture_batch import PictureView, SeenPicture, collate_pictures
from coopsim.nn.camera.picture_detector import PointsAndPicturesNet
from coopsim.nn.covariance.box_numbers import own_numbers
from coopsim.nn.covariance.box_patch import box_patches
from coopsim.nn.covariance.covariance_net import CovarianceNet
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.inference.inference import inference, side_by_side
from coopsim.nn.inference.perceiver import compass_region
from coopsim.nn.inference.quick import QuickEncoder, folded
from coopsim.nn.inference.quick_pictures import QuickBothEncoder
from coopsim.types import BevGrid, Detections
from coopsim.types.estimates import diagonals


class CloudDetector:
    """A `DetectorNet` that looks for objects in clouds of points.

    Attributes:
        sweeps: number of sweeps that it was trained on.

    Args:
        net: the network.
        threads: clouds are looked at side by side on so many.
        covariance: a network that replaces the covariances of `detect_around`; None: they stay those of the head.
    """

    def __init__(self, net: DetectorNet, threads: int = 1, covariance: CovarianceNet | None = None) -> None:
        self._encoder, self._head, self._covariance = QuickEncoder(net.encoder), folded(net.head), covariance
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
        detect = self._detect if self._covariance is None else self._detect_with_covariance
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        return side_by_side([partial(detect, region, least_score, points) for points in clouds], self._threads)

    def detect_patches(
        self, points: NDArray[np.float32], reach_m: float, least_score: float
    ) -> tuple[Detections, Floats]:
        """Return the N detections around one agent, as `detect_around`, and their `box_patches` (N, 9 C)."""
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        with inference():
            return self._seen(region, least_score, points)

    def _detect(self, region: BevGrid, least_score: float, points: NDArray[np.float32]) -> Detections:
        with inference():
            return self._found(self._features(region, points), region, least_score)

    def _detect_with_covariance(self, region: BevGrid, least_score: float, points: NDArray[np.float32]) -> Detections:
        assert self._covariance is not None
        with inference():
            found, patches = self._seen(region, least_score, points)
        looks = patches if self._covariance.config.features else None
        variance = self._covariance.variances(own_numbers(found.boxes.array, found.score), looks)
        return replace(found, covariance=diagonals(variance))

    def _seen(self, region: BevGrid, least_score: float, points: NDArray[np.float32]) -> tuple[Detections, Floats]:
        features = self._features(region, points)
        found = self._found(features, region, least_score)
        return found, box_patches(features[0].float(), torch.from_numpy(found.boxes.array), region).numpy()

    def _features(self, region: BevGrid, points: NDArray[np.float32]) -> Tensor:
        pillars = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        return self._encoder(collate([pillarize(points, pillars)]))

    def _found(self, features: Tensor, region: BevGrid, least_score: float) -> Detections:
        return decode(self._head, features, region, least_score=least_score)[0]


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
