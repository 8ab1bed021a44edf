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
from coopsim.localization.odometry import Points, turned
from coopsim.nn.camera.picture_batch import PictureView, SeenPicture, collate_pictures
from coopsim.nn.camera.picture_detector import PointsAndPicturesNet
from coopsim.nn.covariance.box_numbers import own_numbers
from coopsim.nn.covariance.box_patch import box_patches
from coopsim.nn.covariance.covariance_net import CovarianceNet
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.inference.backend import PROCESSOR, Backend
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
        backend: on which it computes; the covariances' network, which is tiny, stays on the processor.
        covariance: a network that replaces the covariances of `detect_around`; None: they stay those of the head.
    """

    def __init__(self, net: DetectorNet, backend: Backend = PROCESSOR, covariance: CovarianceNet | None = None) -> None:
        self._encoder, self._head = QuickEncoder(net.encoder, backend), backend.place(folded(net.head))
        self._covariance, self._backend = covariance, backend
        self._cell_m, self.sweeps = STRIDE * net.config.cell_m, net.config.sweeps

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
        return self._detect(region, least_score, [points])[0]

    def detect_around(
        self, clouds: Sequence[NDArray[np.float32]], reach_m: float, least_score: float
    ) -> list[Detections]:
        """Return the detections in clouds (P, 5) of A agents, in a square of +-`reach_m` around each."""
        detect = self._detect if self._covariance is None else self._detect_with_covariance
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        return self._backend.map(partial(detect, region, least_score), clouds)

    def detect_patches(
        self, points: NDArray[np.float32], reach_m: float, least_score: float
    ) -> tuple[Detections, Floats]:
        """Return the N detections around one agent, as `detect_around`, and their `box_patches` (N, 9 C)."""
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        with self._backend.inference():
            return self._seen(region, least_score, [points])[0]

    def _detect(self, region: BevGrid, least_score: float, clouds: Sequence[NDArray[np.float32]]) -> list[Detections]:
        with self._backend.inference():
            return decode(self._head, self._features(region, clouds), region, least_score=least_score)

    def _detect_with_covariance(
        self, region: BevGrid, least_score: float, clouds: Sequence[NDArray[np.float32]]
    ) -> list[Detections]:
        with self._backend.inference():
            seen = self._seen(region, least_score, clouds)
        return [self._judged(*each) for each in seen]

    def _judged(self, found: Detections, patches: Floats) -> Detections:
        assert self._covariance is not None
        looks = patches if self._covariance.config.features else None
        variance = self._covariance.variances(own_numbers(found.boxes.array, found.score), looks)
        return replace(found, covariance=diagonals(variance))

    def _seen(
        self, region: BevGrid, least_score: float, clouds: Sequence[NDArray[np.float32]]
    ) -> list[tuple[Detections, Floats]]:
        features = self._features(region, clouds)
        found = decode(self._head, features, region, least_score=least_score)
        boxes = [self._backend.put(torch.from_numpy(each.boxes.array)) for each in found]
        patches = [box_patches(*each, region) for each in zip(features.float(), boxes, strict=True)]
        return list(zip(found, (each.numpy(force=True) for each in patches), strict=True))

    def _features(self, region: BevGrid, clouds: Sequence[NDArray[np.float32]]) -> Tensor:
        pillars = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        return self._encoder(collate([pillarize(points, pillars) for points in clouds]))


class CloudAndPicturesDetector:
    """A `PointsAndPicturesNet` that looks for objects in a cloud of points, of one agent or several, and in pictures.

    Args:
        net: the network.
        backend: on which it computes.
    """

    def __init__(self, net: PointsAndPicturesNet, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._head = QuickBothEncoder(net.encoder, backend), backend.place(folded(net.head))
        self._cell_m, self._backend = STRIDE * net.config.pictures.cell_m, backend

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
        with self._backend.inference():
            features = self._encoder(collate([pillarize(points, canvas)]), collate_pictures([seen]))
            return decode(self._head, features, region, least_score=least_score)[0]
