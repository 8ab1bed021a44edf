"""The encoder: pillars of points to a map of features seen from above."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.detector.pillars import POINT_FEATURES, GroundSettings, PillarBatch, PillarSettings
from coopsim.support.checks import require_choice, require_count, require_positive

STRIDE = 2
"""Cells of the features are this many pillars wide."""

COARSEST = 8
"""Rows and columns of a grid of pillars must divide by this."""

MOST_CHANNELS, _MOST_LAYERS = 1024, 32
"""Files of weights say how large their network is: none takes more memory than this allows."""

LAYOUTS = ("dense", "sparse")
"""Kinds of encoders: of all cells, or of those where points are."""

HEADS = ("centre", "turned", "judged", "street")
"""Kinds of heads: files of weights name theirs. "turned" is "centre" with a second look at each box, for which of its
ends is the front. "judged" computes where features are, and looks again for that and for how well the box fits.
"street" is "judged"; beside it, a network on two sweeps compares them for how each box moves."""

GROUNDS = ("smooth", "local")
"""Rules of the ground: see `coopsim.nn.detector.ground` and `coopsim.nn.detector.local_ground`."""


@dataclass(frozen=True, slots=True)
class EncoderConfig:
    """Sizes of an encoder, and which head is on it.

    Attributes:
        cell_m: edge of a pillar.
        pillar_features: channels of a pillar.
        channels: channels of the three scales, at 2, 4 and 8 pillars.
        layers: convolutions of each scale after the first one.
        features: channels of the result.
        sweeps: number of sweeps that it is given: 1, or 2 (the one before is moved by odometry).
        head: one of `HEADS`.
        layout: one of `LAYOUTS`.
        ground: one of `GROUNDS`, over which heights are measured.
        bands_m: heights over it at which pillars are divided; each band has a maximum of its own.
        apart: the sweep before has a maximum of its own, so that a pillar shows what came and what left.
    """

    cell_m: float = 0.6
    pillar_features: int = 32
    channels: tuple[int, int, int] = (48, 64, 96)
    layers: tuple[int, int, int] = (2, 3, 3)
    features: int = 64
    sweeps: int = 1
    head: str = "centre"
    layout: str = "dense"
    ground: str = "smooth"
    bands_m: tuple[float, ...] = ()
    apart: bool = False

    def __post_init__(self) -> None:
        require_positive(cell_m=self.cell_m)
        require_count(1, MOST_CHANNELS, pillar_features=self.pillar_features, features=self.features)
        require_count(1, 2, sweeps=self.sweeps)
        require_choice("head", self.head, HEADS)
        require_choice("layout", self.layout, LAYOUTS)
        require_choice("ground", self.ground, GROUNDS)
        object.__setattr__(self, "bands_m", self.pillars.bands_m)
        if self.apart and self.sweeps == 1:
            raise InvalidValueError("apart must be false with sweeps: 1, where there is no sweep before")
        for name in ("channels", "layers"):
            given = tuple(getattr(self, name))
            if len(given) != 3:
                raise InvalidValueError(f"{name} must have 3 numbers, one for each scale, got {given}")
            least, most = (1, MOST_CHANNELS) if name == "channels" else (0, _MOST_LAYERS)
            require_count(least, most, **{f"{name}[{k}]": one for k, one in enumerate(given)})
            object.__setattr__(self, name, given)

    @property
    def tells_motion(self) -> bool:
        """True if both sweeps are compared for how boxes move."""
        return self.head == "street" and self.sweeps > 1

    @property
    def pillars(self) -> PillarSettings:
        """Rule by which the encoder's points are gathered."""
        return PillarSettings(GroundSettings(local=self.ground == "local"), self.bands_m, self.apart)


class MapEncoder(nn.Module):
    """The part that all encoders share: from a canvas, seen from above, through three scales to a map of features."""

    def make_scales(self, config: EncoderConfig) -> None:
        """Make the layers, for canvases of `config.pillar_features` channels."""
        widths = (config.pillar_features, *config.channels)
        self.scales = nn.ModuleList(
            nn.Sequential(conv(before, after, 2), *(conv(after, after) for _ in range(layers)))
            for before, after, layers in zip(widths, config.channels, config.layers, strict=False)
        )
        joined = max(8, config.features // 2)
        self.sides = nn.ModuleList(nn.Conv2d(width, joined, 1, bias=False) for width in config.channels)
        self.join = conv(3 * joined, config.features)

    def of_canvas(self, canvas: Tensor) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative, of canvases (A, pillar_features, H, W)."""
        below, sides = canvas, []
        for scale, side in zip(self.scales, self.sides, strict=True):
            below = scale(below)
            sides.append(side(below))
        finest = sides[0].shape[-2:]
        sides[1:] = [functional.interpolate(each, size=finest, mode="nearest") for each in sides[1:]]
        features: Tensor = self.join(torch.cat(sides, dim=1))
        return features


class PointLayer(nn.Module):
    """The part that all encoders of points share: a linear layer, and a maximum over each pillar's points.

    Source: PointPillars (Lang et al., CVPR 2019), section 2.1.
    """

    def make_points(self, config: EncoderConfig) -> None:
        """Make the layers."""
        self.points = nn.Linear(POINT_FEATURES, config.pillar_features, bias=False)
        self.points_norm = nn.BatchNorm1d(config.pillar_features, eps=1e-3, momentum=0.05)
        self.parts = config.pillars.parts
        if self.parts > 1:
            self.mix = nn.Linear(self.parts * config.pillar_features, config.pillar_features, bias=False)
            self.mix_norm = nn.BatchNorm1d(config.pillar_features, eps=1e-3, momentum=0.05)

    def of_pillars(self, batch: PillarBatch) -> Tensor:
        """Return the features (M, pillar_features) of the pillars that have points, in float32."""
        if self.parts == 1:
            return self.of_parts(batch)
        return functional.relu(batch_normed(self.mix_norm, self.mix(self.of_parts(batch)).float()))

    def of_parts(self, batch: PillarBatch) -> Tensor:
        """Return the features (M, B pillar_features) of the B parts of each pillar; zeros of those without points."""
        if not len(batch.features):
            return batch.features.new_zeros(len(batch.cell), self.parts * self.points.out_features)
        each = functional.relu(batch_normed(self.points_norm, self.points(batch.features).float()))
        if self.parts == 1:
            return torch.segment_reduce(each, "max", lengths=batch.count, axis=0)
        return torch.segment_reduce(each, "max", lengths=batch.count, axis=0, initial=0.0).view(len(batch.cell), -1)


def batch_normed(norm: nn.Module, rows: Tensor) -> Tensor:
    """Return rows (P, C), normalized; fewer than two have no statistics, and take those of earlier ones."""
    if len(rows) > 1 or not norm.training or not isinstance(norm, nn.BatchNorm1d):
        normed: Tensor = norm(rows)
        return normed
    return functional.batch_norm(rows, norm.running_mean, norm.running_var, norm.weight, norm.bias, eps=norm.eps)


class PillarEncoder(MapEncoder, PointLayer):
    """Encoder of PointPillars on all cells: three scales, joined. For weights that were trained so."""

    def __init__(self, config: EncoderConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or EncoderConfig()
        self.make_points(config)
        self.make_scales(config)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # how canvases lie: faster

    def forward(self, batch: PillarBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative.

        Raises:
            InvalidValueError: rows or columns of the grid do not divide by 8.
        """
        require_grid(batch)
        return self.of_canvas(self.canvas(batch))

    def canvas(self, batch: PillarBatch) -> Tensor:
        """Return the pillars' features on their grids, (A, C, H, W); zeros where no point is."""
        rows, columns = batch.shape
        width = self.config.pillar_features
        numbers = next(self.join.parameters()).dtype  # shorter than the points' in a quick encoder
        flat = batch.features.new_zeros(batch.clouds * rows * columns, width, dtype=numbers)
        flat.index_put_((batch.cell,), self.of_pillars(batch).to(flat.dtype))
        return flat.view(batch.clouds, rows, columns, width).permute(0, 3, 1, 2)


def require_grid(batch: PillarBatch) -> None:
    """Raise `InvalidValueError` unless rows and columns of pillars divide by the coarsest scale."""
    if any(cells % COARSEST for cells in batch.shape):
        raise InvalidValueError(f"rows and columns of pillars must divide by {COARSEST}, got {batch.shape}")


def conv(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """Return a 3 x 3 convolution with batch normalisation and ReLU."""
    return nn.Sequential(
        nn.Conv2d(before, after, 3, stride, 1, bias=False),
        nn.BatchNorm2d(after, eps=1e-3, momentum=0.05),
        nn.ReLU(),
    )
