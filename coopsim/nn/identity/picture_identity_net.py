"""A small network of identity from pictures: crops of objects to unit vectors.

It stands where DINO-CoDT (He et al., sec. III-G, eq. 7-8) has the 31st block of DINOv2, whose 1536 numbers for a box
are 93 times as many bytes as the box. This one has 64 and is trained for the one question whether two crops show the
same object.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.nn.detector.encoder import MOST_CHANNELS, conv
from coopsim.support.checks import require_between, require_count


@dataclass(frozen=True, slots=True)
class PictureIdentityConfig:
    """Sizes of the network.

    Attributes:
        edge_px: edge of a resized crop; a multiple of 8.
        margin: share of width and height that a crop has around the box, on each side.
        channels: channels of the maps at 2, 2, 4 and 8 pixels of the resized crop.
        dim: D, length of a vector.
    """

    edge_px: int = 40
    margin: float = 0.1
    channels: tuple[int, int, int, int] = (24, 32, 64, 96)
    dim: int = 64

    def __post_init__(self) -> None:
        require_count(8, 512, edge_px=self.edge_px)
        if self.edge_px % 8:
            raise InvalidValueError(f"edge_px must be a multiple of 8, got {self.edge_px}")
        require_between(0, 2, margin=self.margin)
        if not isinstance(self.channels, (tuple, list)) or len(self.channels) != 4:
            raise InvalidValueError(f"channels must be 4 numbers, one for each scale, got {self.channels!r}")
        for k, width in enumerate(self.channels):
            require_count(1, MOST_CHANNELS, **{f"channels[{k}]": width})
        require_count(1, 4096, dim=self.dim)
        object.__setattr__(self, "channels", tuple(self.channels))


class PictureIdentityNet(nn.Module):
    """Convolutions, then the mean of each channel and row of the map, and its largest value, then a vector of length 1.

    Rows stay apart and columns do not: above and below are the same from all sides, left and right are not.
    """

    def __init__(self, config: PictureIdentityConfig) -> None:
        super().__init__()
        self.config = config
        strides = (1, 2, 2)
        layers = [conv(3, config.channels[0], 2)]
        for (before, after), stride in zip(itertools.pairwise(config.channels), strides, strict=True):
            layers += [conv(before, after, stride), conv(after, after)] if stride == 2 else [conv(before, after)]
        self.maps = nn.Sequential(*layers)
        self.last = nn.Linear((config.edge_px // 8 + 1) * config.channels[-1], config.dim)

    @property
    def dim(self) -> int:
        """Length of a vector, D."""
        return self.config.dim

    def forward(self, crops: Tensor) -> Tensor:
        """Return unit vectors (K, D).

        Args:
            crops: (K, 3, E, E) in [0, 255], of `coopsim.nn.identity.picture_identity_net.cut_crops`.
        """
        seen = (crops.float() / 127.5 - 1).contiguous(memory_format=torch.channels_last)
        maps = self.maps(seen)
        vectors = self.last(torch.cat([maps.mean(dim=3).flatten(1), maps.amax(dim=(2, 3))], dim=1))
        return functional.normalize(vectors.float(), dim=1)


_LEAST_PX = 2


def cut_crops(rgb: NDArray[np.uint8], place_px: Floats, edge_px: int, margin: float) -> Tensor:
    """Cut rectangles out of a picture (H, W, 3) and resize them to squares, (K, 3, E, E) float32 in [0, 255].

    Args:
        rgb: the picture.
        place_px: (K, 4) first column, first row, last column, last row, edges as of
            `coopsim.sensors.camera.projection.Crops`; finite.
        edge_px: E, edge of a resized crop.
        margin: background on each side, as a share of the rectangle's width or height, within the picture.
    """
    crops = torch.empty(len(place_px), 3, edge_px, edge_px)
    for number, (left, top, right, bottom) in enumerate(place_px.tolist()):
        beside, above = margin * (right - left), margin * (bottom - top)
        columns = _pixels(left - beside, right + beside, rgb.shape[1])
        rows = _pixels(top - above, bottom + above, rgb.shape[0])
        part = torch.from_numpy(rgb[rows, columns].transpose(2, 0, 1).astype(np.float32))
        crops[number] = functional.interpolate(part[None], (edge_px, edge_px), mode="bilinear", antialias=True)[0]
    return crops


def _pixels(first: float, last: float, length: int) -> slice:
    """Return the pixels that an interval of a row or column touches, at least two of them."""
    begin = min(max(math.floor(first + 0.5), 0), max(length - _LEAST_PX, 0))
    return slice(begin, min(max(math.ceil(last + 0.5), begin + _LEAST_PX), length))
