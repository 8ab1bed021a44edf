"""The network of one agent: encoder and head."""

from __future__ import annotations

from torch import nn

from coopsim.nn.detector.centre_head import CentreHead
from coopsim.nn.detector.encoder import EncoderConfig, PillarEncoder


class DetectorNet(nn.Module):
    """An encoder of points and the head on its features; state: `encoder.*`, `head.*`."""

    def __init__(self, config: EncoderConfig | None = None) -> None:
        super().__init__()
        self.config = config or EncoderConfig()
        self.encoder = PillarEncoder(self.config)
        self.head = CentreHead(self.config.features)
