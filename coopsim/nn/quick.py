"""Networks made quicker for use: normalisations folded into what comes before them, numbers as short as the processor
multiplies them. The results are those of the network that was trained, up to rounding.
"""

from __future__ import annotations

import copy
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from coopsim.errors import InvalidValueError
from coopsim.nn.encoder import COARSEST, PillarEncoder
from coopsim.nn.inference import multiplies_bfloat16
from coopsim.nn.pillars import PillarBatch

M = TypeVar("M", bound=nn.Module)


def folded(module: M) -> M:
    """Return a copy of a network in which batch normalisations after convolutions are part of these."""
    made = copy.deepcopy(module).eval().requires_grad_(False)
    for each in list(made.modules()):
        if isinstance(each, nn.Sequential):
            for number in range(len(each) - 1):
                conv, norm = each[number], each[number + 1]
                if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                    each[number], each[number + 1] = fuse_conv_bn_eval(conv, norm), nn.Identity()
    return made


class QuickEncoder:
    """A `PillarEncoder` for use alone.

    Args:
        encoder: the one that was trained.
    """

    def __init__(self, encoder: PillarEncoder) -> None:
        made = folded(encoder)
        self._points = fuse_linear_bn_eval(encoder.points, encoder.points_norm).requires_grad_(False)
        self._type = torch.bfloat16 if multiplies_bfloat16() else torch.float32
        made.to(self._type)
        made.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._scales, self._sides, self._join = made.scales, made.sides, made.join

    def __call__(self, batch: PillarBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative; without gradients.

        Raises:
            InvalidValueError: rows or columns of the grid do not divide by 8.
        """
        if any(cells % COARSEST for cells in batch.shape):
            raise InvalidValueError(f"rows and columns of pillars must divide by {COARSEST}, got {batch.shape}")
        with torch.autocast("cpu", enabled=False):
            below, sides = self._canvas(batch), []
            for scale, side in zip(self._scales, self._sides, strict=True):
                below = scale(below)
                sides.append(side(below))
            finest = sides[0].shape[-2:]
            sides[1:] = [functional.interpolate(each, size=finest, mode="nearest") for each in sides[1:]]
            features: Tensor = self._join(torch.cat(sides, dim=1))
        return features

    def _canvas(self, batch: PillarBatch) -> Tensor:
        rows, columns = batch.shape
        width = self._points.out_features
        flat = torch.zeros(batch.clouds * rows * columns, width, dtype=self._type)
        if len(batch.features):
            each = functional.linear(batch.features, self._points.weight, self._points.bias).relu_()
            most = torch.segment_reduce(each, "max", lengths=batch.count, axis=0)
            flat[batch.cell] = most.to(self._type)
        return flat.view(batch.clouds, rows, columns, width).permute(0, 3, 1, 2)
