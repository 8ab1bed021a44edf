"""The network of DMSTrack: from what is known of a box to the covariance of its numbers.

Its positional variant is told where the box is; the other one also reads the detecting agent's map of features there.

Chiu et al., "Probabilistic 3D Multi-Object Cooperative Tracking for Autonomous Driving via Differentiable Multi-Sensor
Kalman Filter", ICRA 2024.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.nn.covariance.box_filter import BoxFilter
from coopsim.nn.covariance.box_numbers import ANGLES, NUMBERS, SCORE, SHORT
from coopsim.support.checks import require_count, require_flag
from coopsim.tracking.motion.constant_velocity import MEASURED, ConstantVelocity
from coopsim.types import BevGrid

LEAST_VARIANCE, MOST_VARIANCE = 1e-4, 1e2
"""Bounds of a learned variance, m^2 or rad^2."""

_FAR, _SHORT = 200.0, 10.0  # m, of distances and of heights and sizes, that are one unit

_ROWS = 64  # boxes at once

_FIRST_VARIANCE = 0.1
_FIRST_GROWTH, _FIRST_SPEED_GROWTH, _FIRST_SPEED_VARIANCE = 1.0, 10.0, 100.0


@dataclass(frozen=True, slots=True)
class CovarianceConfig:
    """Sizes of the network.

    Attributes:
        codes: numbers that each input becomes: sines and cosines.
        widths: widths of the hidden layers.
        constant: learn one covariance for all boxes, as a baseline.
        features: channels of the detecting agent's map, which the network reads around the box; 0: it does not.
        seen: numbers that it makes of these.
    """

    codes: int = 16
    widths: tuple[int, ...] = (128, 64)
    constant: bool = False
    features: int = 0
    seen: int = 32

    def __post_init__(self) -> None:
        require_count(2, 256, codes=self.codes)
        require_count(0, 1024, features=self.features)
        require_count(1, 4608, seen=self.seen)
        require_flag(constant=self.constant)
        if self.constant and self.features:
            raise InvalidValueError(f"features must be 0 with constant: true, got {self.features}")
        if self.codes % 2:
            raise InvalidValueError(f"codes must be even, half sines and half cosines, got {self.codes}")
        if not isinstance(self.widths, (tuple, list)) or not 1 <= len(self.widths) <= 8:
            raise InvalidValueError(f"widths must be 1 to 8 numbers, got {self.widths!r}")
        for k, width in enumerate(self.widths):
            require_count(1, 4608, **{f"widths[{k}]": width})
        object.__setattr__(self, "widths", tuple(self.widths))


class CovarianceNet(nn.Module):
    """Variances of boxes, and the noise of the motion that they fit to.

    The result is diagonal in the receiver's base frame, as the source's is. A filter weighs a box by its variance
    against that of the prediction, so the growth of the latter is learned along: nine numbers, the same for all.
    """

    def __init__(self, config: CovarianceConfig) -> None:
        super().__init__()
        self.config = config
        looks = config.features > 0
        self.look = nn.Linear(config.features * PLACES**2, config.seen) if looks else None
        widths = (config.codes * NUMBERS + config.seen * looks, *config.widths)
        hidden = [layer for a, b in itertools.pairwise(widths) for layer in (nn.Linear(a, b), nn.ReLU())]
        self.hidden = nn.Sequential(*hidden) if not config.constant else None
        self.last = nn.Linear(widths[-1], MEASURED) if not config.constant else None
        if self.last is not None:
            nn.init.zeros_(self.last.weight)
            nn.init.zeros_(self.last.bias)
        self.base = nn.Parameter(torch.full((MEASURED,), _logit(_FIRST_VARIANCE)))
        self.log_growth = nn.Parameter(torch.full((MEASURED,), math.log(_FIRST_GROWTH)))
        self.log_speed = nn.Parameter(torch.tensor([math.log(_FIRST_SPEED_GROWTH), math.log(_FIRST_SPEED_VARIANCE)]))
        unit = torch.full((NUMBERS,), 1 / _FAR)
        unit[list(SHORT)] = 1 / _SHORT
        unit[[*ANGLES, SCORE]] = 1.0
        frequency = math.pi / 2 ** (2 * torch.arange(config.codes // 2) / config.codes)
        self.register_buffer("scale", unit[:, None] * frequency, persistent=False)

    def forward(self, numbers: Tensor, patches: Tensor | None = None) -> Tensor:
        """Return the variances (N, 7) of x, y, z, l, w, h, yaw, of `box_numbers` (N, 19) and, if features are read,
        `box_patches`.
        """
        scale = self.base.expand(len(numbers), -1)
        if self.hidden is not None and self.last is not None:
            angle = (numbers[:, :, None] * self.get_buffer("scale")).flatten(1)
            known = [angle.sin(), angle.cos()]
            if self.look is not None:
                assert patches is not None, "patches must be given to a network that reads features"
                known.append(self.look(patches).relu())
            scale = scale + self.last(self.hidden(torch.cat(known, dim=1)))
        return _bounded(scale.float())

    def variances(self, numbers: Floats, patches: Floats | None = None) -> Floats:
        """Return `forward` of arrays (N, 19) and (N, 9 C), without gradients, as an array (N, 7).

        A row's result does not depend on the other rows: products of matrices of other sizes are rounded otherwise, so
        all have one size.
        """
        found = np.empty((len(numbers), MEASURED))
        given = [each for each in (numbers, patches) if each is not None]
        padded = [torch.zeros(_ROWS, each.shape[1]) for each in given]
        with torch.no_grad():
            for first in range(0, len(numbers), _ROWS):
                count = len(numbers[first : first + _ROWS])
                for into, each in zip(padded, given, strict=True):
                    into[:count] = torch.from_numpy(each[first : first + _ROWS].astype(np.float32))
                found[first : first + _ROWS] = self(*padded)[:count].double().numpy()
        return found

    def box_filter(self) -> BoxFilter:
        """Return the filter with the learned noise of the motion, through which gradients pass."""
        speed_growth, speed = self.log_speed.double().exp()
        return BoxFilter(self.log_growth.double().exp(), speed_growth, speed)

    def motion(self) -> ConstantVelocity:
        """Return the motion model with the learned noise; boxes without a covariance have a middling one."""
        with torch.no_grad():
            growth, (speed_growth, speed) = self.log_growth.double().exp(), self.log_speed.double().exp().tolist()
            usual = _bounded(self.base.double())
        return ConstantVelocity(
            initial_variance=tuple(usual.tolist()),
            initial_velocity_variance=speed,
            process_variance_per_s=tuple(growth.tolist()),
            process_velocity_variance_per_s=speed_growth,
            measurement_variance=tuple(usual.tolist()),
        )


def _bounded(logit: Tensor) -> Tensor:
    """Return variances within their bounds; a hard bound would have no gradient."""
    lowest, highest = math.log(LEAST_VARIANCE), math.log(MOST_VARIANCE)
    return torch.exp(lowest + (highest - lowest) * torch.sigmoid(logit))


def _logit(variance: float) -> float:
    """Return the number of which the network makes this variance."""
    lowest, highest = math.log(LEAST_VARIANCE), math.log(MOST_VARIANCE)
    share = (math.log(variance) - lowest) / (highest - lowest)
    return math.log(share / (1 - share))


PLACES = 3
"""Places along the length, and across the width, of a box at which the map is read."""

_REACH = 0.75  # of length and width, from the box's middle: the outer places are beyond its sides


def box_patches(features: Tensor, boxes: Tensor, grid: BevGrid) -> Tensor:
    """Return the features (N, 9 C) at 3 x 3 places in and around boxes, row by row from the left of the back.

    The places turn with the box, unlike the source's: so an object looks the same whatever its heading. Between cells
    features (C, h, w) are interpolated; beyond the map they are zero. Boxes (N, 7) are in the frame of the grid.
    """
    places = patch_places(boxes.to(features), grid)
    found = functional.grid_sample(features[None], places[None], align_corners=False)  # (1, C, N, 9)
    return found[0].permute(1, 2, 0).flatten(1)


def patch_places(boxes: Tensor, grid: BevGrid) -> Tensor:
    """Return the places (..., 9, 2) of `box_patches` of boxes (..., 7): x and y, -1 to 1 over the grid."""
    steps = torch.linspace(-_REACH, _REACH, PLACES, dtype=boxes.dtype, device=boxes.device)
    ahead, left = (each.flatten() for each in torch.meshgrid(steps, -steps, indexing="ij"))
    ahead, left = boxes[..., 3:4] * ahead, boxes[..., 4:5] * left
    cos, sin = boxes[..., 6:7].cos(), boxes[..., 6:7].sin()
    x, y = boxes[..., 0:1] + cos * ahead - sin * left, boxes[..., 1:2] + sin * ahead + cos * left
    (x_low, x_high), (y_low, y_high) = grid.x_m, grid.y_m
    return torch.stack([2 * (x - x_low) / (x_high - x_low) - 1, 2 * (y - y_low) / (y_high - y_low) - 1], dim=-1)
