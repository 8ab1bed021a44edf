"""The cooperative network: what an agent's own network does not have, from the message to the fused map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from coopsim.nn.cooperative.expand import Expand
from coopsim.nn.cooperative.feature_flow import FeatureFlow
from coopsim.nn.detector.centre_head import RARE, CentreHead
from coopsim.nn.detector.encoder import MOST_CHANNELS
from coopsim.nn.fusion import FUSIONS, FeatureFusion, Foreground, FusionContext, as_batch
from coopsim.nn.fusion.feature_fusion import start_as_zeros
from coopsim.support.checks import require_count
from coopsim.types.taxonomy import CLASS_NAMES


@dataclass(frozen=True, slots=True)
class CooperativeConfig:
    """Everything but the weights.

    Attributes:
        fusion: name in `FUSIONS`.
        parameters: of the fusion, by name.
        message_channels: numbers a cell in a message.
        features: numbers a cell in the encoder's maps.
        flow: width of the network that tells how a sender's map changes (`FeatureFlow`); 0: there is none.

    Raises:
        InvalidValueError: a count is not positive, or larger than any network's.
    """

    fusion: str = "attfuse"
    parameters: Mapping[str, object] = field(default_factory=dict)
    message_channels: int = 16
    features: int = 64
    flow: int = 0

    def __post_init__(self) -> None:
        require_count(1, MOST_CHANNELS, message_channels=self.message_channels, features=self.features)
        require_count(0, MOST_CHANNELS, flow=self.flow)


class CooperativeNet(nn.Module):
    """Messages of an encoder's features, and the features that a receiver makes of its own map and those messages.

    A sender calls `message`; a receiver warps what it gets by `coopsim.nn.cooperative.warp`, calls the network, and
    gives the result to `.head`. Until others report something, the result is the own map itself.

    Args:
        fusion: how maps become one, made for `features` channels.
        message_channels: numbers a cell in a message.
        features: numbers a cell in the encoder's maps.
        flow: width of the network of maps' change; 0: there is none.

    Attributes:
        config: the options; only of a network that was made `from_config`.
    """

    config: CooperativeConfig

    def __init__(self, fusion: FeatureFusion, message_channels: int = 16, features: int = 64, flow: int = 0) -> None:
        super().__init__()
        self.message_channels = message_channels
        self.flow = FeatureFlow(message_channels, flow) if flow else None
        self.compress = nn.Sequential(
            nn.Conv2d(features, features, 1), nn.ReLU(inplace=True), nn.Conv2d(features, message_channels, 1)
        )
        self.sure = nn.Conv2d(features, len(CLASS_NAMES), 1)
        nn.init.constant_(self.sure.bias, RARE)  # type: ignore[arg-type]
        self.expand = Expand(message_channels, features)
        self.fusion = fusion
        self.neck = nn.Sequential(  # each channel over 6 m, then across channels: a third of the time of both at once
            nn.Conv2d(features, features, 5, padding=2, groups=features),
            nn.Conv2d(features, features, 1),
            nn.ReLU(inplace=True),
            nn.Conv2d(features, features, 1),
        )
        self.head = CentreHead(features)
        start_as_zeros(self.neck[-1])

    @classmethod
    def from_config(cls, config: CooperativeConfig) -> CooperativeNet:
        """Make the network with fresh weights.

        Raises:
            UnknownNameError: no fusion has this name.
        """
        fusion = FUSIONS.get(config.fusion)(config.features, **config.parameters)
        net = cls(fusion, config.message_channels, config.features, config.flow)
        net.config = config
        return net

    def message(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return what A agents send: values (A, C, h, w), and how sure they are of each cell (A, h, w) in [0, 1].

        Args:
            features: (A, features, h, w), of the encoder.
        """
        values: Tensor = self.compress(features).float()
        return values, self.confidence(features)

    def confidence(self, features: Tensor) -> Tensor:
        """Return the largest probability of any class, (A, h, w), of features (A, features, h, w)."""
        confidence: Tensor = self.sure(features).float().amax(1).sigmoid()
        return confidence

    def forward(self, own: Tensor, own_mask: Tensor, received: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Return fused features (features, H, W), for `.head`.

        Args:
            own: (features, H, W) >= 0, the receiver's own features, uncompressed, zero where its map does not reach.
            own_mask: (H, W) bool, where it reaches.
            received: (S, C, H, W), what S senders sent, warped.
            mask: (S, H, W) bool, the valid cells of it.
            context: of the senders; a missing confidence of the own map is computed.
        """
        if not len(received):
            return own
        return self._refined(*self._prepare(own, own_mask, received, mask, context))

    def with_beliefs(
        self, own: Tensor, own_mask: Tensor, received: Tensor, mask: Tensor, context: FusionContext
    ) -> tuple[Tensor, list[Foreground]]:
        """Return fused features, and what the fusion believes about where objects are, for a loss that teaches both.

        Arguments as of `forward`, with one sender at least. What was received is expanded once for both.
        """
        prepared = self._prepare(own, own_mask, received, mask, context)
        return self._refined(*prepared), self.fusion.foreground(*prepared)

    def _refined(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Return fused features after the neck, from expanded maps of the others."""
        fused: Tensor = self.fusion(own, own_mask, others, mask, context)
        refined: Tensor = self.neck(as_batch(fused))[0]
        return fused + refined * mask.any(0).to(refined.dtype)

    def _prepare(
        self, own: Tensor, own_mask: Tensor, received: Tensor, mask: Tensor, context: FusionContext
    ) -> tuple[Tensor, Tensor, Tensor, Tensor, FusionContext]:
        """Return the fusion's arguments: received maps expanded, in the fastest memory layout, the context complete."""
        own = own.permute(1, 2, 0).contiguous().permute(2, 0, 1)
        others: Tensor = self.expand(received.contiguous(memory_format=torch.channels_last), context.delay_s)
        sure = context.own_confidence
        if sure is None and context.confidence is not None:
            sure = self.confidence(as_batch(own))[0]
        return own, own_mask, others, mask, replace(context, own_confidence=sure)
