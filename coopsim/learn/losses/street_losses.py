"""Loss of a `SweepMotion`: velocities of what moves by themselves, as shares of the speed.

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


def motion_loss(motion: Tensor, true: Tensor) -> Tensor:
    """Return the errors of motions (N, 2), m/s, each as a share of 1 m/s and the object's speed.

    It is the mean over objects that move, plus half of that over those that stand.
    """
    speed = true.norm(dim=1, keepdim=True)
    error = (motion - true) / (1 + speed)
    each = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none", beta=0.1).sum(dim=1)
    moves = speed[:, 0] >= MOVING_M_S
    moving, standing = (each[some].sum() / some.sum().clamp(min=1) for some in (moves, ~moves))
    total: Tensor = moving + _STANDING * standing
    return total
