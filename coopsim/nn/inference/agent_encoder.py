"""Encoders of one agent's sensor data: from points, from pictures, or from what each agent has, to features."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from coopsim.localization.odometry import RecentSweeps, turned
from coopsim.nn.camera.picture_batch import PictureView, collate_pictures
from coopsim.nn.camera.picture_detector import PictureDetectorNet, PointsAndPicturesNet
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.pillars import Pillars, collate, pillarize
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.quick import QuickEncoder
from coopsim.nn.inference.quick_pictures import QuickBothEncoder, QuickPictureEncoder, pictures_of
from coopsim.types import BevGrid, SensorView


class Together(Protocol):
    """An encoder of several agents' inputs at once, in one batch."""

    def __call__(self, inputs: Sequence[Any], /) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What an agent saw in a frame, to be encoded. Looks of several agents may be encoded by several threads.

    Attributes:
        encoder: of the inputs; the same object for all looks that may be one batch.
        gather: from the cells of a canvas in the agent's compass frame to the encoder's input.
    """

    encoder: Together
    gather: Callable[[BevGrid], Any]


def encoded(looks: Sequence[Look], canvases: Sequence[BevGrid]) -> Tensor:
    """Return features (A, C, H / 2, W / 2) of A looks on canvases of one shape: a batch for each encoder among them."""
    found: dict[int, Tensor] = {}
    for encoder in {id(look.encoder): look.encoder for look in looks}.values():
        rows = [row for row, look in enumerate(looks) if look.encoder is encoder]
        made = encoder([looks[row].gather(canvases[row]) for row in rows])
        if len(rows) == len(looks):
            return made
        found.update((row, made[k : k + 1]) for k, row in enumerate(rows))
    return torch.cat([found[row] for row in range(len(looks))])


class AgentEncoder(Protocol):
    """An encoder of agents' sensor data. All encoders of one policy make features that mean the same."""

    def look(self, view: SensorView) -> Look:
        """Take in what an agent saw; to be called once in each frame of an agent, in order."""
        ...


class PointEncoder:
    """The encoder of an agent's points. An agent without any has the map of an empty world.

    Args:
        detector: has the encoder.
        backend: on which it computes.
    """

    def __init__(self, detector: DetectorNet, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._sweeps = QuickEncoder(detector.encoder, backend), RecentSweeps(detector.config.sweeps)

    def look(self, view: SensorView) -> Look:
        """Take in an agent's points; see `AgentEncoder.look`."""
        points = turned(self._sweeps.points(view), _heading_rad(view))
        return Look(self, partial(pillarize, points))

    def __call__(self, inputs: Sequence[Pillars]) -> Tensor:
        """Return features of agents' pillars; see `Together`."""
        return self._encoder(collate(inputs))


class PictureEncoder:
    """The encoder of an agent's pictures.

    Args:
        net: has the encoder.
        backend: on which it computes.
    """

    def __init__(self, net: PictureDetectorNet, backend: Backend = PROCESSOR) -> None:
        self._encoder = QuickPictureEncoder(net.encoder, backend)

    def look(self, view: SensorView) -> Look:
        """Take in an agent's pictures; see `AgentEncoder.look`.

        Raises:
            InvalidValueError: an image has no colours.
        """
        pictures, compass_SE2_base = pictures_of(view), np.array([0.0, 0.0, _heading_rad(view)])
        return Look(self, partial(PictureView, pictures, compass_SE2_base))

    def __call__(self, inputs: Sequence[PictureView]) -> Tensor:
        """Return features of agents' pictures; see `Together`."""
        return self._encoder(collate_pictures(inputs))


class BothEncoder:
    """The encoder of an agent's points and pictures together.

    Args:
        net: has the encoder.
        backend: on which it computes.
    """

    def __init__(self, net: PointsAndPicturesNet, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._sweeps = QuickBothEncoder(net.encoder, backend), RecentSweeps(1)

    def look(self, view: SensorView) -> Look:
        """Take in an agent's points and pictures; see `AgentEncoder.look`.

        Raises:
            InvalidValueError: an image has no colours.
        """
        heading_rad = _heading_rad(view)
        points, pictures = self._sweeps.points(view), pictures_of(view)
        compass_SE2_base, around = np.array([0.0, 0.0, heading_rad]), turned(points, heading_rad)

        def gather(canvas: BevGrid) -> tuple[Pillars, PictureView]:
            seen = PictureView(pictures, compass_SE2_base, canvas, points_m=points[:, :3])
            return pillarize(around, canvas), seen

        return Look(self, gather)

    def __call__(self, inputs: Sequence[tuple[Pillars, PictureView]]) -> Tensor:
        """Return features of agents' pillars and pictures; see `Together`."""
        pillars, seen = zip(*inputs, strict=True)
        return self._encoder(collate(pillars), collate_pictures(seen))


class MixedEncoder:
    """The encoder of points for agents with a LiDAR, and for those without any sensor; of pictures for the others.

    Args:
        points: the first one.
        pictures: the second one.
    """

    def __init__(self, points: AgentEncoder, pictures: AgentEncoder) -> None:
        self._points, self._pictures = points, pictures

    def look(self, view: SensorView) -> Look:
        """Take in what an agent's sensors gave; see `AgentEncoder.look`."""
        only_cameras = bool(view.cameras) and not view.lidars
        return (self._pictures if only_cameras else self._points).look(view)


def _heading_rad(view: SensorView) -> float:
    return 0.0 if view.pose is None else float(view.pose.xyz_yaw[3])
