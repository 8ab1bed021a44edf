"""Losses of a `StreetHead`'s codes: the front as one of two classes, and velocities of what moves by themselves.

Most objects stand, so a mean over all of them hardly asks for velocities, and least for large ones: a network that
guesses a tenth of each is nearly right. Here what moves is one mean and what stands another, and errors count by the
speed.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.learn.samples.targets import Targets
from coopsim.nn.detector.detector_net import VELOCITY, VELOCITY_SCALE, front_logits

MOVING_M_S = 0.5
"""Speed from which an object moves."""

_STANDING = 0.5
"""Weight of what stands against what moves."""


def front_class_loss(code: Tensor, targets: Targets) -> Tensor:
    """Return the cross entropy of the class "the front lies this way" against "it lies behind", a mean by heat."""
    each = functional.softplus(-front_logits(code, targets.yaw))
    return _mean(each, targets.weight)


def velocity_loss(code: Tensor, targets: Targets) -> Tensor:
    """Return the errors of velocities, each as a share of 1 m/s and the object's speed.

    It is the mean over cells whose objects move, plus half of that over those whose objects stand, both by heat and
    where the sample shows motion.
    """
    true = targets.code[:, VELOCITY] * VELOCITY_SCALE
    speed = true.norm(dim=1, keepdim=True)
    error = (code[:, VELOCITY] * VELOCITY_SCALE - true) / (1 + speed)
    each = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none", beta=0.1).sum(dim=1)
    moving = (speed[:, 0] >= MOVING_M_S).float()
    weight = targets.weight * targets.moves
    return _mean(each, weight * moving) + _STANDING * _mean(each, weight * (1 - moving))


def _mean(each: Tensor, weight: Tensor) -> Tensor:
    return (each * weight).sum() / weight.sum().clamp(min=1.0)
