"""Crops of pictures as tensors of one size."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from coopsim.geometry.se3 import Floats

_LEAST_PX = 2


def cut_crops(rgb: NDArray[np.uint8], place_px: Floats, edge_px: int, margin: float) -> Tensor:
    """Cut rectangles out of a picture and resize them, whatever their shapes, to squares.

    Args:
        rgb: (H, W, 3) the picture.
        place_px: (K, 4) first column, first row, last column, last row, edges as of
            `coopsim.sensors.camera.crops.Crops`; finite.
        edge_px: E, edge of a resized crop.
        margin: what is added on each side, as a share of the rectangle's width or height: what an object stands before
            tells where it ends. It ends at the picture's edge.

    Returns:
        (K, 3, E, E) float32 in [0, 255].
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
