"""Network on single pictures: features, depths and classes of their cells.

Depths are a choice among bins, which a network predicts better than a number, and can leave undecided. Bins grow
linearly with depth (Reading et al., "Categorical Depth Distribution Network for Monocular 3D Object Detection", CVPR
2021, section 3.1): the middle of bin k of K is near + (far - near) k (k + 1) / (K (K - 1)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.picture_batch import GEOMETRY
from coopsim.nn.detector.encoder import conv
from coopsim.support.checks import require_count, require_positive
from coopsim.support.registry import Registry
from coopsim.types.taxonomy import CLASS_NAMES

_COARSEST_PX = 16
_UNLIKELY = 0.01  # share of bins in which the ground is not


@dataclass(frozen=True, slots=True, eq=False)
class PictureFeatures:
    """Output of a network for M pictures.

    Attributes:
        features: (M, C, h, w).
        depth: (M, K + 1, h, w) logits of bins, see `DepthBins`.
        label: (M, 10, h, w) logits of classes, the last one for scenery and sky.
    """

    features: Tensor
    depth: Tensor
    label: Tensor


BACKBONES: Registry[Callable[[int], nn.Module]] = Registry("backbone", group="coopsim.backbones")
"""Makers of backbones, by name. A backbone takes pictures (M, 3, H, W) in [-1, 1], H and W divisible by 16, and the
geometry of their cells (M, 4, H / 8, W / 8), and gives maps (M, width, H / 8, W / 8). Register one of your own to start
from weights that were trained elsewhere."""


@BACKBONES.register("small")
class SmallBackbone(nn.Module):
    """Convolutions at 2, 4, 8 and 16 pixels, of 16 to 64 channels, to be trained from scratch."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.fine = nn.Sequential(conv(3, 16, 2), conv(16, 24, 2), conv(24, 24), conv(24, 48, 2))
        self.middle = nn.Sequential(conv(48 + GEOMETRY, 48), conv(48, 48))
        self.coarse = nn.Sequential(conv(48, 64, 2), conv(64, 64), conv(64, 64))
        self.join = nn.Sequential(
            nn.Conv2d(48 + 64, width, 1, bias=False), nn.BatchNorm2d(width, eps=1e-3, momentum=0.05), nn.ReLU()
        )

    def forward(self, pictures: Tensor, geometry: Tensor) -> Tensor:
        """Return maps (M, width, H / 8, W / 8)."""
        middle = self.middle(torch.cat([self.fine(pictures), geometry], 1))
        wide = functional.interpolate(self.coarse(middle), size=middle.shape[-2:], mode="nearest")
        joined: Tensor = self.join(torch.cat([middle, wide], 1))
        return joined


class PictureNet(nn.Module):
    """Backbone, and layers that read features, depths and classes from its map.

    The depth of the ground along each ray is known for any camera. There the prediction of depth begins: an object on
    the ground is nearer than the ground behind it.

    Args:
        features: C of a cell.
        bins: bins of depth.
        backbone: name in `BACKBONES`.
        width: channels of the backbone's map.
    """

    def __init__(self, features: int, bins: DepthBins, backbone: str = "small", width: int = 64) -> None:
        super().__init__()
        self._bins, self._width = bins, width
        self.backbone = BACKBONES.get(backbone)(width)
        self.hidden = nn.Sequential(nn.Conv2d(width + bins.count + 1, width, 1), nn.ReLU(inplace=True))
        self.depth = nn.Conv2d(width, bins.count + 1, 1)
        self.ground = nn.Parameter(torch.ones(()))
        self.features = nn.Conv2d(width, features, 1)
        self.label = nn.Conv2d(width, len(CLASS_NAMES) + 1, 1)

    def forward(self, rgb: Tensor, geometry: Tensor) -> PictureFeatures:
        """Read pictures (M, 3, H, W) in [0, 255], with the geometry (M, 4, h, w) of
        `coopsim.nn.camera.picture_batch.CellRays`.

        Raises:
            InvalidValueError: the backbone gives maps of another shape than `BACKBONES` says.
        """
        rows, columns = geometry.shape[-2:]
        missing = [-length % _COARSEST_PX for length in rgb.shape[-2:]]
        pictures = functional.pad(rgb.to(geometry.dtype) / 127.5 - 1, (0, missing[1], 0, missing[0]))
        pictures = pictures.contiguous(memory_format=torch.channels_last)
        cells = [length // 8 for length in pictures.shape[-2:]]
        around = functional.pad(geometry, (0, cells[1] - columns, 0, cells[0] - rows))
        seen = self.backbone(pictures, around)
        wanted = (len(pictures), self._width, *cells)
        if tuple(seen.shape) != wanted:
            raise InvalidValueError(f"backbone must give maps of shape {wanted}, gave {tuple(seen.shape)}")
        seen = seen[..., :rows, :columns]
        ground = self._bins.shares(10.0 / geometry[:, 0].float().clamp_min(1e-3)).to(seen.dtype)
        hidden = self.hidden(torch.cat([seen, ground], 1))
        depth = self.depth(hidden) + self.ground * torch.log(ground + _UNLIKELY)
        return PictureFeatures(self.features(hidden), depth, self.label(hidden))


@dataclass(frozen=True, slots=True)
class DepthBins:
    """K bins of depth, of which the first and last middles are given, and one more for all beyond them."""

    nearest_m: float = 2.0
    farthest_m: float = 60.0
    count: int = 64

    def __post_init__(self) -> None:
        require_positive(nearest_m=self.nearest_m, farthest_m=self.farthest_m)
        require_count(2, 512, depth_bins=self.count)
        if self.nearest_m >= self.farthest_m:
            raise InvalidValueError(
                f"nearest_m must be less than farthest_m, got {self.nearest_m!r} and {self.farthest_m!r}"
            )

    def middles(self) -> Tensor:
        """Return the bins' middles, (K,) m."""
        k = torch.arange(self.count, dtype=torch.float32)
        return self.nearest_m + (self.farthest_m - self.nearest_m) * k * (k + 1) / (self.count * (self.count - 1))

    def shares(self, depth_m: Tensor) -> Tensor:
        """Return depths (M, ...) as shares of bins (M, K + 1, ...): of the two bins beside a depth, by nearness.

        A depth before the first bin counts as in it. What is farther than the last one, or 0 for nothing, is beyond.
        """
        middles = self.middles().to(depth_m.device)
        beyond = (depth_m <= 0) | (depth_m > self.farthest_m)
        inside = depth_m.clamp(self.nearest_m, self.farthest_m)
        above = torch.searchsorted(middles, inside.contiguous()).clamp(1, self.count - 1)
        low, high = middles[above - 1], middles[above]
        share = ((inside - low) / (high - low)).clamp(0, 1)
        share, lower = share.masked_fill(beyond, 1.0), (above - 1).masked_fill(beyond, 0)
        upper = above.masked_fill(beyond, self.count)
        out = depth_m.new_zeros((depth_m.shape[0], self.count + 1, *depth_m.shape[1:]))
        out.scatter_(1, lower[:, None], (1 - share)[:, None])
        return out.scatter_add_(1, upper[:, None], share[:, None])
