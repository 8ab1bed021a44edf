"""Encoders of agents' sensor data for inference: from points, pictures, or whatever each agent has, to features.

Normalisations are folded into the layers before them, and numbers are as short as the device multiplies them. The
results are those of the trained network, up to rounding.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.localization.odometry import Points, RecentSweeps, turned
from coopsim.nn.camera.lift_splat import PictureDetectorNet
from coopsim.nn.camera.picture_batch import PictureView, SeenPicture, collate_pictures
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesNet
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.encoder import PillarEncoder
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.detector.sparse_cells import SparseConv
from coopsim.nn.detector.sparse_encoder import SparseEncoder
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.types import BevGrid, SensorView

M = TypeVar("M", bound=nn.Module)


@dataclass(frozen=True, slots=True, eq=False)
class SensedFrame:
    """Sensor data of one agent in a frame, ready to be encoded on any canvas in its compass frame.

    Attributes:
        encoder: encoder of these data; frames of one encoder may be one batch.
        points: (P, 5) in the compass frame.
        pictures: images with calibrations in the base frame.
        depth_points_m: (P, 3) in the base frame, which measure depths in the pictures.
        heading_rad: estimated heading of the agent.
        position_m: (2,) estimated position of the agent in the world.
    """

    encoder: FrameEncoder
    points: Points = field(default_factory=lambda: np.zeros((0, 5), np.float32))
    pictures: Sequence[SeenPicture] = ()
    depth_points_m: Points | None = None
    heading_rad: float = 0.0
    position_m: Floats = field(default_factory=lambda: np.zeros(2))

    def picture_view(self, canvas: BevGrid) -> PictureView:
        """Return the pictures for a network that gathers them on a canvas."""
        pose = np.array([0.0, 0.0, self.heading_rad])
        return PictureView(self.pictures, pose, canvas, points_m=self.depth_points_m)


class SensorEncoder(ABC):
    """Encoder of agents' sensor data. All encoders of one policy make features that mean the same."""

    @abstractmethod
    def take(self, view: SensorView) -> SensedFrame:
        """Take in an agent's sensor data; to be called once in each frame of an agent, in order.

        Raises:
            InvalidValueError: an image that is needed has no colours.
        """


class FrameEncoder(SensorEncoder):
    """Encoder of several agents' frames in one batch."""

    @abstractmethod
    def encode(self, frames: Sequence[SensedFrame], canvases: Sequence[BevGrid]) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative, of A frames on canvases of one shape, without gradients.

        Raises:
            InvalidValueError: rows or columns of the canvases do not divide by 8.
        """


class PointEncoder(FrameEncoder):
    """Encoder of points. An agent without any has the map of an empty world."""

    def __init__(self, detector: DetectorNet, backend: Backend = PROCESSOR) -> None:
        self._encoder = backend.place(for_inference(detector.encoder, backend.numbers))
        self._backend, self._sweeps = backend, RecentSweeps(detector.config.sweeps)
        self._settings = detector.config.pillars

    def take(self, view: SensorView) -> SensedFrame:
        heading_rad, position_m = stated_place(view)
        points = turned(self._sweeps.points(view), heading_rad)
        return SensedFrame(self, points, heading_rad=heading_rad, position_m=position_m)

    def encode(self, frames: Sequence[SensedFrame], canvases: Sequence[BevGrid]) -> Tensor:
        both = zip(frames, canvases, strict=True)
        batch = collate([pillarize(each.points, canvas, self._settings) for each, canvas in both])
        with torch.autocast(self._backend.device.type, enabled=False):
            features: Tensor = self._encoder(self._backend.put(batch))
        return features


class PictureEncoder(FrameEncoder):
    """Encoder of pictures. Depths and sums on canvases are float32 always."""

    def __init__(self, net: PictureDetectorNet, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._backend = backend.place(folded(net.encoder)), backend
        self._encoder.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def take(self, view: SensorView) -> SensedFrame:
        heading_rad, position_m = stated_place(view)
        return SensedFrame(self, pictures=pictures_of(view), heading_rad=heading_rad, position_m=position_m)

    def encode(self, frames: Sequence[SensedFrame], canvases: Sequence[BevGrid]) -> Tensor:
        batch = collate_pictures([each.picture_view(canvas) for each, canvas in zip(frames, canvases, strict=True)])
        features: Tensor = self._encoder(self._backend.put(batch))
        return features


class BothEncoder(FrameEncoder):
    """Encoder of points and pictures together."""

    def __init__(self, net: PointsAndPicturesNet, backend: Backend = PROCESSOR) -> None:
        made = folded(net.encoder)
        made.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        points: Any = for_inference(net.encoder.points, backend.numbers)
        made.points = points
        self._encoder, self._backend, self._sweeps = backend.place(made), backend, RecentSweeps(1)

    def take(self, view: SensorView) -> SensedFrame:
        heading_rad, position_m = stated_place(view)
        points = self._sweeps.points(view)
        around = turned(points, heading_rad)
        return SensedFrame(self, around, pictures_of(view), points[:, :3], heading_rad, position_m)

    def encode(self, frames: Sequence[SensedFrame], canvases: Sequence[BevGrid]) -> Tensor:
        both = list(zip(frames, canvases, strict=True))
        pillars = collate([pillarize(each.points, canvas) for each, canvas in both])
        pictures = collate_pictures([each.picture_view(canvas) for each, canvas in both])
        features: Tensor = self._encoder(self._backend.put(pillars), self._backend.put(pictures))
        return features


class MixedEncoder(SensorEncoder):
    """Encoder of points for agents with a LiDAR or without any sensor, of pictures for the others."""

    def __init__(self, points: SensorEncoder, pictures: SensorEncoder) -> None:
        self._points, self._pictures = points, pictures

    def take(self, view: SensorView) -> SensedFrame:
        only_cameras = bool(view.cameras) and not view.lidars
        return (self._pictures if only_cameras else self._points).take(view)


def encode_frames(frames: Sequence[SensedFrame], canvases: Sequence[BevGrid]) -> Tensor:
    """Return features (A, C, H / 2, W / 2) of A frames on canvases of one shape, in a batch for each encoder."""
    found: dict[int, Tensor] = {}
    for encoder in {id(each.encoder): each.encoder for each in frames}.values():
        rows = [row for row, each in enumerate(frames) if each.encoder is encoder]
        made = encoder.encode([frames[row] for row in rows], [canvases[row] for row in rows])
        if len(rows) == len(frames):
            return made
        found.update((row, made[k : k + 1]) for k, row in enumerate(rows))
    return torch.cat([found[row] for row in range(len(frames))])


def stated_place(view: SensorView) -> tuple[float, Floats]:
    """Return an agent's estimated heading in rad and position (2,) m; zeros without a pose."""
    return (0.0, np.zeros(2)) if view.pose is None else (float(view.pose.xyz_yaw[3]), view.pose.xyz_yaw[:2])


def pictures_of(view: SensorView) -> list[SeenPicture]:
    """Return an agent's pictures in colour, with their calibrations; none where its cameras gave no image.

    Raises:
        InvalidValueError: an image has no colours.
    """
    images = {camera: view.images[camera] for camera in view.cameras if camera in view.images}
    pictures = []
    for camera, image in images.items():
        if image.rgb is None:
            raise InvalidValueError(
                f"a network on pictures needs their colours, but camera {camera!r} of {view.agent} has none: make the "
                'environment with "rgb" among camera_modes'
            )
        pictures.append(SeenPicture(image.rgb, view.cameras[camera]))
    return pictures


def folded(module: M) -> M:
    """Return a copy of a network in which batch normalisations after convolutions are part of these."""
    made = copy.deepcopy(module).eval().requires_grad_(False)
    for each in list(made.modules()):
        if isinstance(each, SparseConv):
            each.fold()
        elif isinstance(each, nn.Sequential):
            for number in range(len(each) - 1):
                conv, norm = each[number], each[number + 1]
                if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                    each[number], each[number + 1] = fuse_conv_bn_eval(conv, norm), nn.Identity()
    return made


def for_inference(encoder: PillarEncoder | SparseEncoder, numbers: torch.dtype) -> PillarEncoder | SparseEncoder:
    """Return a faster copy of an encoder of points, whose maps have these numbers."""
    made = folded(encoder)
    made.points = fuse_linear_bn_eval(made.points, made.points_norm).requires_grad_(False)
    made.points_norm = nn.Identity()  # type: ignore[assignment]
    if made.parts > 1:
        made.mix = fuse_linear_bn_eval(made.mix, made.mix_norm).requires_grad_(False)
        made.mix_norm = nn.Identity()  # type: ignore[assignment]
    if isinstance(made, SparseEncoder):
        made.shorten(numbers)
        return made
    for maps in (made.scales, made.sides, made.join):
        maps.to(numbers)
        maps.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return made
