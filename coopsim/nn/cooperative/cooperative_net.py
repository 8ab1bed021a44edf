"""Network of cooperating agents, besides each agent's own: compress, expand, move in time, fuse, detect.

Feature flow is that of Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D Multi-Object Tracking in
Vehicle-Infrastructure Cooperation", eq. 6-9, after FFNet (Yu et al., "Flow-Based Feature Fusion for
Vehicle-Infrastructure Cooperative 3D Object Detection", NeurIPS 2023).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.detector.detector_net import RARE, make_head
from coopsim.nn.detector.encoder import HEADS, MOST_CHANNELS
from coopsim.nn.fusion import FeatureFusion, Foreground, FusionContext, as_batch
from coopsim.nn.fusion.feature_fusion import find_fusion, start_as_zeros
from coopsim.support.checks import require_between, require_choice, require_count, require_flag
from coopsim.types.taxonomy import CLASS_NAMES


@dataclass(frozen=True, slots=True)
class CooperativeConfig:
    """Sizes of the network.

    Attributes:
        fusion: name in `FUSIONS`, or place of a class, see `find_fusion`.
        parameters: parameters of the fusion, by name.
        message_channels: numbers a cell in a message.
        features: numbers a cell in the encoder's maps.
        flow: width of `FeatureFlow`; 0: there is none.
        surest: factor on confidences that the fusion's logits begin with, see `FeatureFusion.choose_surest`; 0: none.
        told_errors: the expansion is told each cell's distance from its sender and the error of its place.
        head: kind of the head, see `make_head`; that of the detector.

    Raises:
        InvalidValueError: a count is not positive, or larger than any network's.
    """

    fusion: str = "attfuse"
    parameters: Mapping[str, object] = field(default_factory=dict)
    message_channels: int = 64
    features: int = 64
    flow: int = 0
    surest: float = 0.0
    told_errors: bool = False
    head: str = "centre"

    def __post_init__(self) -> None:
        require_flag(told_errors=self.told_errors)
        require_between(0, 100, surest=self.surest)
        require_choice("head", self.head, HEADS)
        require_count(1, MOST_CHANNELS, message_channels=self.message_channels, features=self.features)
        require_count(0, MOST_CHANNELS, flow=self.flow)


class CooperativeNet(nn.Module):
    """Messages of an encoder's features, and the features that a receiver makes of its own map and those messages.

    A sender calls `message`; a receiver warps messages by `coopsim.nn.cooperative.warp`, calls the network, and gives
    the result to `.head`. Until others report something, the result is the own map itself. Arguments are as in
    `CooperativeConfig`, with a fusion made for `features` channels; `config` is set by `from_config` alone.
    """

    config: CooperativeConfig

    def __init__(
        self,
        fusion: FeatureFusion,
        message_channels: int = 64,
        features: int = 64,
        flow: int = 0,
        told_errors: bool = False,
        head: str = "centre",
    ) -> None:
        super().__init__()
        self.message_channels = message_channels
        self.flow = FeatureFlow(message_channels, flow) if flow else None
        self.compress = nn.Sequential(
            nn.Conv2d(features, features, 1), nn.ReLU(inplace=True), nn.Conv2d(features, message_channels, 1)
        )
        self.sure = nn.Conv2d(features, len(CLASS_NAMES), 1)
        nn.init.constant_(self.sure.bias, RARE)  # type: ignore[arg-type]
        self.expand = Expand(message_channels, features, told_errors)
        if message_channels == features:
            start_as_identity(self.compress[0], self.compress[2], self.expand.hidden, self.expand.mix)
        self.fusion = fusion
        self.neck = nn.Sequential(  # each channel over 6 m, then across channels: a third of the time of both at once
            nn.Conv2d(features, features, 5, padding=2, groups=features),
            nn.Conv2d(features, features, 1),
            nn.ReLU(inplace=True),
            nn.Conv2d(features, features, 1),
        )
        self.head = make_head(head, features)
        start_as_zeros(self.neck[-1])

    @classmethod
    def from_config(cls, config: CooperativeConfig) -> CooperativeNet:
        """Make the network with fresh weights.

        Raises:
            UnknownNameError: no fusion has this name.
            InvalidValueError: the place of the fusion has no class of fusions.
        """
        fusion = find_fusion(config.fusion)(config.features, **config.parameters)
        if config.surest:
            fusion.choose_surest(config.surest)
        net = cls(fusion, config.message_channels, config.features, config.flow, config.told_errors, config.head)
        net.config = config
        return net

    @property
    def tells_errors(self) -> bool:
        """True where the expansion is told `FusionContext.error_m` and `range_m`."""
        return self.expand.placed is not None

    def message(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return the message of A agents' features (A, features, h, w): values (A, C, h, w) and confidences (A, h, w)
        in [0, 1].
        """
        values: Tensor = self.compress(features).float()
        return values, self.confidence(features)

    def confidence(self, features: Tensor) -> Tensor:
        """Return the largest probability of any class, (A, h, w), of features (A, features, h, w)."""
        confidence: Tensor = self.sure(features).float().amax(1).sigmoid()
        return self.fusion.smoothed(confidence)

    def forward(self, own: Tensor, own_mask: Tensor, received: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
        """Return fused features (features, H, W), for `.head`.

        Args:
            own: (features, H, W) >= 0, the receiver's own features, uncompressed, zero where its map does not reach.
            own_mask: (H, W) bool, where it reaches.
            received: (S, C, H, W), the messages of S senders, warped.
            mask: (S, H, W) bool, the valid cells of it.
            context: facts about the senders; a missing confidence of the own map is computed.
        """
        if not len(received):
            return own
        return self._refined(*self._prepare(own, own_mask, received, mask, context))

    def with_beliefs(
        self, own: Tensor, own_mask: Tensor, received: Tensor, mask: Tensor, context: FusionContext
    ) -> tuple[Tensor, list[Foreground]]:
        """Return fused features, and the fusion's foreground logits, for a loss that teaches both.

        Arguments as of `forward`, with one sender at least. Messages are expanded once for both.
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
        """Return the fusion's arguments: received maps expanded where they are valid, the context complete."""
        own = own.permute(1, 2, 0).contiguous().permute(2, 0, 1)
        others: Tensor = self.expand(received, context.delay_s, context.error_m, context.range_m, mask)
        sure = context.own_confidence
        if sure is None and context.confidence is not None:
            sure = self.confidence(as_batch(own))[0]
        return own, own_mask, others, mask, replace(context, own_confidence=sure)


def start_as_identity(*layers: nn.Module) -> None:
    """Let layers of one cell begin as the identity, so that features, which are not negative, pass unchanged."""
    for layer in layers:
        assert isinstance(layer, nn.Conv2d | nn.Linear) and layer.bias is not None
        with torch.no_grad():
            layer.weight.copy_(torch.eye(*layer.weight.shape[:2]).view_as(layer.weight))
            layer.bias.zero_()


_SCALES_S = (0.1, 0.3, 1.0)
_ERROR_SCALE_M, _RANGE_SCALE_M = 0.5, 50.0


class Expand(nn.Module):
    """Expand compressed features: a 3x3 convolution of each channel, then in each cell two layers with ReLU.

    Late features may be spread over their surroundings, weakened or dropped: the kernel of the convolution, the bias of
    the hidden layer and the gain of each feature are base + D s, where s = 1 - exp(-delay / (0.1, 0.3, 1 s)) is 0 for a
    message without delay and at most 1 for any, and D starts as zeros. Thanks to the hidden layer eight channels lose a
    head about as little as sixteen would without.

    A network with `told_errors` knows of each cell e = 1 - exp(-error / 0.5 m) and r = 1 - exp(-range / 50 m), and adds
    a product with (e, r), which starts as zeros, to the bias of the hidden layer and to the gain.
    """

    def __init__(self, channels: int, features: int, told_errors: bool = False) -> None:
        super().__init__()
        hidden = max(32, channels)
        self.spread = nn.Parameter(torch.zeros(channels, 1, 3, 3))
        self.hidden = nn.Linear(channels, hidden)
        self.mix = nn.Linear(hidden, features)
        self.delayed = nn.Linear(len(_SCALES_S), channels * 9 + hidden + features, bias=False)
        self.placed = start_as_zeros(nn.Linear(2, hidden + 1, bias=False)) if told_errors else None
        self.register_buffer("scales_s", torch.tensor(_SCALES_S), persistent=False)
        nn.init.zeros_(self.delayed.weight)
        with torch.no_grad():
            self.spread[:, :, 1, 1] = 1.0

    def forward(
        self,
        received: Tensor,
        delay_s: Tensor,
        error_m: Tensor | None = None,
        range_m: Tensor | None = None,
        wanted: Tensor | None = None,
    ) -> Tensor:
        """Expand (S, C, H, W), S >= 1, of delays (S,) to (S, features, H, W) >= 0.

        Args:
            received: the messages.
            delay_s: their ages.
            error_m: (S, H, W) standard deviation of each cell's place; None: 0.
            range_m: (S, H, W) distance of each cell from its sender; None: 0.
            wanted: (S, H, W) bool, the cells of which the result is used; None: all. If they are few, only they are
                computed, and all others are 0.
        """
        sizes = [len(self.spread) * 9, self.hidden.out_features, self.mix.out_features]
        scales_s = self.get_buffer("scales_s")
        late = 1 - torch.exp(-delay_s.to(scales_s).clamp_min(0)[:, None] / scales_s)
        kernel, bias, gain = self.delayed(late).float()[:, None].split(sizes, 2)
        kernels = (self.spread.flatten() + kernel).view(-1, *self.spread.shape)
        away = None
        if self.placed is not None and error_m is not None and range_m is not None:
            away = torch.stack([error_m / _ERROR_SCALE_M, range_m / _RANGE_SCALE_M], -1)
        if wanted is None or wanted.sum() > _FEW * wanted.numel():
            cells = _spread(received, kernels)
            mixed = self._mix(cells.flatten(1, 2), bias, gain, None if away is None else away.flatten(1, 2))
            return mixed.view(*cells.shape[:3], -1).permute(0, 3, 1, 2)
        found = []
        for number, where in enumerate(wanted):
            rows, columns = where.nonzero(as_tuple=True)
            cells = _spread_at(received[number], kernels[number], rows, columns)[None]
            told = None if away is None else away[number, rows, columns][None]
            found.append(self._mix(cells, bias[number, None], gain[number, None], told)[0])
        values = torch.cat(found)
        expanded = values.new_zeros(*wanted.shape, values.shape[-1])
        expanded[wanted] = values
        return expanded.permute(0, 3, 1, 2)

    def _mix(self, cells: Tensor, bias: Tensor, gain: Tensor, away: Tensor | None) -> Tensor:
        """Return (S, n, features) of n cells (S, n, C) of each sender after the convolution.

        Args:
            cells: results of the convolution.
            bias: (S, 1, hidden), added to the hidden layer.
            gain: (S, 1, features), of the result, less 1.
            away: (S, n, 2) error and range of each cell, by their scales; None: not told.
        """
        within = torch.matmul(cells, self.hidden.weight.T)
        within = within.add_((self.hidden.bias + bias).to(within.dtype))
        if away is not None:
            assert self.placed is not None
            told = self.placed(1 - torch.exp(-away)).to(within.dtype)
            within = (within + told[..., :-1]).relu() * (1 + told[..., -1:]).relu()
        within = within.relu_()
        expanded = torch.bmm(within, self.mix.weight.T * (1 + gain))
        return expanded.add_((self.mix.bias * (1 + gain)).to(expanded.dtype)).relu_()


_FEW = 0.15
"""Share of wanted cells up to which gathering them takes less time than computing all: of 8 channels; of 64, 0.25."""


def _spread(maps: Tensor, kernels: Tensor) -> Tensor:
    """Convolve maps (S, C, H, W), each channel with its kernel of (S, C, 1, 3, 3); return (S, H, W, C)."""
    maps = maps.contiguous(memory_format=torch.channels_last)  # the fastest layout
    # Split, as single maps would not be recognised as channels last, and copied; the gradient of each slice of a batch
    # would be as large as the batch.
    spread = [
        functional.conv2d(each, kernel, padding=1, groups=len(kernel))
        for each, kernel in zip(torch.split(maps, 1), kernels, strict=True)
    ]
    return torch.cat(spread).permute(0, 2, 3, 1)


def _spread_at(image: Tensor, kernel: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Convolve a map (C, H, W) with a kernel (C, 1, 3, 3) in n cells alone; return (n, C)."""
    padded = functional.pad(image, (1, 1, 1, 1)).permute(1, 2, 0)
    step = torch.arange(3, device=rows.device)
    near = padded[rows[:, None, None] + step[:, None], columns[:, None, None] + step]  # (n, 3, 3, C)
    return (near * kernel[:, 0].permute(1, 2, 0)).sum((1, 2))


LONGEST_S = 0.5
"""Maps further apart than this have too little in common for a derivative, with a little room for rounding."""


class FeatureFlow(nn.Module):
    """Derivative of a sender's features in time, from its map now and the one before.

    Three scales, joined: at cells of 1.2 m the coarsest layers see 60 m, farther than anything moves in a second. The
    last layer starts as zeros: at first nothing moves.
    """

    def __init__(self, channels: int, width: int) -> None:
        super().__init__()
        wide = 2 * width
        self.near = nn.Sequential(_conv(2 * channels + 1, width), _conv(width, width))
        self.middle = nn.Sequential(_conv(width, wide, 2), _conv(wide, wide))
        self.far = nn.Sequential(_conv(wide, wide, 2), _conv(wide, wide), _conv(wide, wide))
        self.sides = nn.ModuleList(nn.Conv2d(each, width, 1) for each in (width, wide, wide))
        self.join = _conv(3 * width, width)
        self.last = start_as_zeros(nn.Conv2d(width, channels, 1))

    def forward(self, now: Tensor, before: Tensor, known: Tensor, interval_s: Tensor) -> Tensor:
        """Return derivatives (A, C, h, w), per second.

        Args:
            now: (A, C, h, w), the features of A senders.
            before: (A, C, h, w), those before, brought into their frame of now; zeros where not `known`.
            known: (A, h, w) bool, the cells that the map before reaches.
            interval_s: (A,) time between both, > 0.
        """
        scales = [self.near(torch.cat([now, before, known[:, None].to(now.dtype)], 1))]
        for scale in (self.middle, self.far):
            scales.append(scale(scales[-1]))
        sides = [side(each) for side, each in zip(self.sides, scales, strict=True)]
        size = sides[0].shape[-2:]
        sides[1:] = [functional.interpolate(each, size=size, mode="nearest") for each in sides[1:]]
        change: Tensor = self.last(self.join(torch.cat(sides, 1))).float()
        return change / interval_s.view(-1, 1, 1, 1).to(change)


def moved_on(values: Tensor, change: Tensor, delay_s: Tensor) -> Tensor:
    """Return maps F (A, C, h, w) after delays (A,), F + dt F' (eq. 9); without delay the maps themselves, bit for bit.

    Raises:
        InvalidValueError: shapes differ.
    """
    if values.shape != change.shape or delay_s.shape != values.shape[:1]:
        raise InvalidValueError(
            f"change must have the shape {tuple(values.shape)} of the maps, and delay_s a number for each, got "
            f"{tuple(change.shape)} and {tuple(delay_s.shape)}"
        )
    delay = delay_s.view(-1, 1, 1, 1).to(values)
    return torch.where(delay == 0, values, values + delay * change)


def _conv(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """Return a 3 x 3 convolution with ReLU, normalised over each map by itself.

    Messages change while the network learns them. Without normalisation all units fall below zero on the way, and no
    gradient brings them back.
    """
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1), nn.GroupNorm(1, after), nn.ReLU())
