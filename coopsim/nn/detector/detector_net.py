"""The network of one agent: encoder and head."""

from __future__ import annotations

from torch import nn

from coopsim.nn.detector.anchor_head import AnchorHead
from coopsim.nn.detector.centre_head import CentreHead
from coopsim.nn.detector.encoder import EncoderConfig, PillarEncoder


class DetectorNet(nn.Module):
    """An encoder of points and the head on its features; state: `encoder.*`, `head.*`.

    Args:
        config: sizes of the encoder, and the kind of the head.
    """

    head: CentreHead | AnchorHead

    def __init__(self, config: EncoderConfig | None = None) -> None:
        super().__init__()
        self.config = config or EncoderConfig()
        self.encoder = PillarEncoder(self.config)
        self.head = make_head(self.config)


def make_head(config: EncoderConfig) -> CentreHead | AnchorHead:
    """Return the head that a network's config names, with fresh weights."""
    if config.head == "centre":
        return CentreHead(config.features)
    return AnchorHead(config.features, direction=config.head == "anchor_direction")
