"""Detectors of one agent for inference: from points, pictures or both to detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.localization.odometry import Points, turned
from coopsim.nn.camera.picture_batch import SeenPicture
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesNet
from coopsim.nn.covariance.box_numbers import own_numbers
from coopsim.nn.covariance.covariance_net import CovarianceNet, box_patches
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import CentreHead, DetectorNet, JudgedHead
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.sweep_motion import SweepMotion
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.canvas import compass_region
from coopsim.nn.inference.encoders import BothEncoder, PointEncoder, SensedFrame, SensorEncoder, encode_frames, folded
from coopsim.types import BevGrid, Detections, SensorView
from coopsim.types.estimates import diagonals


class FrameDetector:
    """Run an encoder and a head on what agents' sensors gave.

    Attributes:
        sweeps: number of sweeps that the encoder was trained on.

    Args:
        encoder: encoder of an agent's sensor data.
        head: head on its features.
        cell_m: edge of a cell of the encoder's canvas.
        backend: device and arithmetic.
    """

    sweeps = 1

    def __init__(
        self, encoder: SensorEncoder, head: CentreHead | JudgedHead, cell_m: float, backend: Backend = PROCESSOR
    ) -> None:
        self._encoder, self._head = encoder, backend.place(folded(head))
        self._cell_m, self._backend = STRIDE * cell_m, backend

    def _found(self, frame: SensedFrame, region_m: tuple[float, float], least_score: float) -> Detections:
        """Return the detections of one agent in a region of its base frame, in the axes of its frame."""
        region = compass_region(region_m, frame.heading_rad, self._cell_m)
        with self._backend.inference():
            return self._decoded(region, least_score, [frame])[0][0]

    def _around(self, frames: Sequence[SensedFrame], reach_m: float, least_score: float) -> list[Detections]:
        """Return the detections of A agents, in a square of +-`reach_m` around each."""
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        return self._backend.map(partial(self._detect, region, least_score), frames)

    def _detect(self, region: BevGrid, least_score: float, frames: Sequence[SensedFrame]) -> list[Detections]:
        with self._backend.inference():
            return self._decoded(region, least_score, frames)[0]

    def _decoded(
        self, region: BevGrid, least_score: float, frames: Sequence[SensedFrame]
    ) -> tuple[list[Detections], Tensor]:
        """Return each frame's detections and the features (A, C, H, W) that they were found in.

        Velocities are known where a network on two sweeps is given two.
        """
        canvas = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        features = encode_frames(frames, [canvas] * len(frames))
        moving = [self.sweeps > 1 and bool((frame.points[:, 4] > 0).any()) for frame in frames]
        return decode(self._head, features, region, least_score=least_score, moving=moving), features


class CloudDetector(FrameDetector):
    """Run a `DetectorNet` on clouds of points, of one agent or several.

    Args:
        net: the network.
        backend: device and arithmetic; the covariances' network, which is tiny, stays on the processor.
        covariance: a network that replaces the covariances of `detect_around`; None: they stay those of the head.
    """

    def __init__(self, net: DetectorNet, backend: Backend = PROCESSOR, covariance: CovarianceNet | None = None) -> None:
        encoder = PointEncoder(net, backend)
        super().__init__(encoder, net.head, net.config.cell_m, backend)
        self._frame, self._covariance, self.sweeps = partial(SensedFrame, encoder), covariance, net.config.sweeps
        self._motion = None if net.motion is None else backend.place(net.motion)

    def detect(
        self, points: NDArray[np.float32], region_m: tuple[float, float], heading_rad: float, least_score: float
    ) -> Detections:
        """Return the detections in points (P, 5), in a region of the base frame and in the points' axes.

        Args:
            points: points in axes in which the agent's heading is `heading_rad`.
            region_m: |x| and |y| at most, in the base frame; see `compass_region`.
            heading_rad: the heading.
            least_score: smallest score of a detection.
        """
        return self._found(self._frame(points, heading_rad=heading_rad), region_m, least_score)

    def detect_around(
        self, clouds: Sequence[NDArray[np.float32]], reach_m: float, least_score: float
    ) -> list[Detections]:
        """Return the detections in clouds (P, 5) of A agents, in a square of +-`reach_m` around each.

        They have velocities where a network on two sweeps is given two.
        """
        return self._around([self._frame(points) for points in clouds], reach_m, least_score)

    def detect_patches(
        self, points: NDArray[np.float32], reach_m: float, least_score: float
    ) -> tuple[Detections, Floats]:
        """Return the N detections around one agent, as `detect_around`, and their `box_patches` (N, 9 C)."""
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        with self._backend.inference():
            return self._seen(region, least_score, [self._frame(points)])[0]

    def _decoded(
        self, region: BevGrid, least_score: float, frames: Sequence[SensedFrame]
    ) -> tuple[list[Detections], Tensor]:
        """Return what `FrameDetector` does, with the velocities of a network that compares both sweeps."""
        found, features = super()._decoded(region, least_score, frames)
        if self._motion is not None:
            both = zip(found, frames, strict=True)
            found = [self._moving(self._motion, each, frame.points) for each, frame in both]
        return found, features

    @staticmethod
    def _moving(motion: SweepMotion, found: Detections, points: Points) -> Detections:
        if found.velocity is None:
            return found
        boxes, velocity = motion.look(points, found.boxes.array)
        return replace(found, boxes=Boxes3D.from_array(boxes), velocity=velocity)

    def _detect(self, region: BevGrid, least_score: float, frames: Sequence[SensedFrame]) -> list[Detections]:
        if self._covariance is None:
            return super()._detect(region, least_score, frames)
        with self._backend.inference():
            seen = self._seen(region, least_score, frames)
        return [self._judged(self._covariance, *each) for each in seen]

    def _judged(self, net: CovarianceNet, found: Detections, patches: Floats) -> Detections:
        looks = patches if net.config.features else None
        return replace(found, covariance=diagonals(net.variances(own_numbers(found.boxes.array, found.score), looks)))

    def _seen(
        self, region: BevGrid, least_score: float, frames: Sequence[SensedFrame]
    ) -> list[tuple[Detections, Floats]]:
        found, features = self._decoded(region, least_score, frames)
        boxes = [self._backend.put(torch.from_numpy(each.boxes.array)) for each in found]
        patches = [box_patches(*each, region) for each in zip(features.float(), boxes, strict=True)]
        return list(zip(found, (each.numpy(force=True) for each in patches), strict=True))


class CloudAndPicturesDetector(FrameDetector):
    """Run a `PointsAndPicturesNet` on a cloud of points, of one agent or several, and on an agent's pictures."""

    def __init__(self, net: PointsAndPicturesNet, backend: Backend = PROCESSOR) -> None:
        encoder = BothEncoder(net, backend)
        super().__init__(encoder, net.head, net.config.pictures.cell_m, backend)
        self._frame = partial(SensedFrame, encoder)

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
        depth_points_m = turned(points, -heading_rad)[:, :3]
        return self._found(self._frame(points, pictures, depth_points_m, heading_rad), region_m, least_score)


class ViewDetector(FrameDetector):
    """Run an encoder and a head on agents' sensor data."""

    def detect_around(self, views: Sequence[SensorView], reach_m: float, least_score: float) -> list[Detections]:
        """Return the detections of A agents, in a square of +-`reach_m` around each, in base frames."""
        # Without a pose, the axes are those of the base frame.
        frames = [self._encoder.take(replace(view, pose=None)) for view in views]
        return self._around(frames, reach_m, least_score)
