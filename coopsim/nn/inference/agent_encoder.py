"""Encoders of one agent's sensor data: from points, from pictures, or from what each agent has, to features."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from torch import Tensor

from coopsim.localization.recent_sweeps import RecentSweeps, turned
from coopsim.nn.camera.picture_batch import PictureView, collate_pictures
from coopsim.nn.camera.picture_detector import PictureDetectorNet, PointsAndPicturesNet
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.pillars import collate, pillarize
from coopsim.nn.inference.quick import QuickEncoder
from coopsim.nn.inference.quick_pictures import QuickBothEncoder, QuickPictureEncoder, pictures_of
from coopsim.types import BevGrid, SensorView

Look = Callable[[BevGrid], Tensor]
"""What an agent saw in a frame, to be encoded: a function from the cells of a canvas in the agent's compass frame to
features (1, C, H / 2, W / 2), not negative. Looks of several agents may be encoded at once, by several threads."""


class AgentEncoder(Protocol):
    """An encoder of agents' sensor data. All encoders of one policy make features that mean the same."""

    def look(self, view: SensorView) -> Look:
        """Take in what an agent saw; to be called once in each frame of an agent, in order."""
        ...


class PointEncoder:
    """The encoder of an agent's points. An agent without any has the map of an empty world.

    Args:
        detector: has the encoder.
    """

    def __init__(self, detector: DetectorNet) -> None:
        self._encoder, self._sweeps = QuickEncoder(detector.encoder), RecentSweeps(detector.config.sweeps)

    def look(self, view: SensorView) -> Look:
        """Take in an agent's points; see `AgentEncoder.look`."""
        points = turned(self._sweeps.points(view), _heading_rad(view))
        return lambda canvas: self._encoder(collate([pillarize(points, canvas)]))


class PictureEncoder:
    """The encoder of an agent's pictures.

    Args:
        net: has the encoder.
    """

    def __init__(self, net: PictureDetectorNet) -> None:
        self._encoder = QuickPictureEncoder(net.encoder)

    def look(self, view: SensorView) -> Look:
        """Take in an agent's pictures; see `AgentEncoder.look`.

        Raises:
            InvalidValueError: an image has no colours.
        """
        pictures, compass_SE2_base = pictures_of(view), np.array([0.0, 0.0, _heading_rad(view)])
        return lambda canvas: self._encoder(collate_pictures([PictureView(pictures, compass_SE2_base, canvas)]))


class BothEncoder:
    """The encoder of an agent's points and pictures together.

    Args:
        net: has the encoder.
    """

    def __init__(self, net: PointsAndPicturesNet) -> None:
        self._encoder, self._sweeps = QuickBothEncoder(net.encoder), RecentSweeps(1)

    def look(self, view: SensorView) -> Look:
        """Take in an agent's points and pictures; see `AgentEncoder.look`.

        Raises:
            InvalidValueError: an image has no colours.
        """
        heading_rad = _heading_rad(view)
        points, pictures = self._sweeps.points(view), pictures_of(view)
        compass_SE2_base, around = np.array([0.0, 0.0, heading_rad]), turned(points, heading_rad)

        def encode(canvas: BevGrid) -> Tensor:
            seen = PictureView(pictures, compass_SE2_base, canvas, points_m=points[:, :3])
            return self._encoder(collate([pillarize(around, canvas)]), collate_pictures([seen]))

        return encode


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
