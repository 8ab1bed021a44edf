"""Networks made quicker for use: normalisations folded into what comes before them, numbers as short as the processor
multiplies them. The results are those of the network that was trained, up to rounding.
"""

from __future__ import annotations

import copy
from typing import TypeVar

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from coopsim.nn.detector.encoder import PillarEncoder
from coopsim.nn.detector.pillars import PillarBatch
from coopsim.nn.inference.backend import PROCESSOR, Backend

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


def quickened(encoder: PillarEncoder, numbers: torch.dtype) -> PillarEncoder:
    """Return a quicker copy of an encoder of points, whose maps have these numbers."""
    made = folded(encoder)
    made.points = fuse_linear_bn_eval(made.points, made.points_norm).requires_grad_(False)
    made.points_norm = nn.Identity()  # type: ignore[assignment]
    for maps in (made.scales, made.sides, made.join):
        maps.to(numbers)
        maps.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return made


class QuickEncoder:
    """A `PillarEncoder` for use alone.

    Args:
        encoder: the one that was trained.
        backend: on which it computes.
    """

    def __init__(self, encoder: PillarEncoder, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._backend = backend.place(quickened(encoder, backend.numbers)), backend

    def __call__(self, batch: PillarBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative; without gradients.

        Raises:
            InvalidValueError: rows or columns of the grid do not divide by 8.
        """
        with torch.autocast(self._backend.device.type, enabled=False):
            features: Tensor = self._encoder(self._backend.put(batch))
        return features
