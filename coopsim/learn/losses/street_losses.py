"""Loss of a `StreetHead`'s motions: velocities of what moves by themselves, as shares of the speed.

Most objects stand, so a mean over all of them hardly asks for velocities, and least for large ones: a network that
guesses a tenth of each is nearly right. Here what moves is one mean and what stands another, and errors count by the
speed.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

MOVING_M_S = 0.5
"""Speed from which an object moves."""

_STANDING = 0.5
"""Weight of what stands against what moves."""


def motion_loss(motion: Tensor, true: Tensor, weight: Tensor) -> Tensor:
    """Return the errors of motions (N, 2), m/s, each as a share of 1 m/s and the object's speed.

    It is the mean over objects that move, plus half of that over those that stand, both by `weight` (N,).
    """
    speed = true.norm(dim=1, keepdim=True)
    error = (motion - true) / (1 + speed)
    each = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none", beta=0.1).sum(dim=1)
    moving = (speed[:, 0] >= MOVING_M_S).float()
    return _mean(each, weight * moving) + _STANDING * _mean(each, weight * (1 - moving))


def _mean(each: Tensor, weight: Tensor) -> Tensor:
    return (each * weight).sum() / weight.sum().clamp(min=1.0)
