"""The networks of one agent with cameras: an encoder of pictures, or of points and pictures, and a head."""

from __future__ import annotations

from torch import nn

from coopsim.nn.camera.lift_splat import LiftSplatConfig, LiftSplatEncoder
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesConfig, PointsAndPicturesEncoder
from coopsim.nn.detector.centre_head import CentreHead


class PictureDetectorNet(nn.Module):
    """An encoder of pictures and the head on its features; state: `encoder.*`, `head.*`.

    Args:
        config: sizes of the encoder.
    """

    def __init__(self, config: LiftSplatConfig | None = None) -> None:
        super().__init__()
        self.config = config or LiftSplatConfig()
        self.encoder = LiftSplatEncoder(self.config)
        self.head = CentreHead(self.config.features)


class PointsAndPicturesNet(nn.Module):
    """An encoder of points and pictures and the head on its features; state: `encoder.*`, `head.*`.

    Args:
        config: sizes of the encoder.
    """

    def __init__(self, config: PointsAndPicturesConfig | None = None) -> None:
        super().__init__()
        self.config = config or PointsAndPicturesConfig()
        self.encoder = PointsAndPicturesEncoder(self.config)
        self.head = CentreHead(self.config.pictures.features)
