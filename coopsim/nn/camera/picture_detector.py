"""The network of one agent with cameras: the encoder of pictures, and a head."""

from __future__ import annotations

from torch import nn

from coopsim.nn.camera.lift_splat import LiftSplatConfig, LiftSplatEncoder
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
