"""Boxes whose motions a sample shows, as inexact as a detector finds them, and the two sweeps around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.localization.odometry import Points
from coopsim.nn.detector.sweep_motion import BoxSweeps, box_sweeps, over_ground

_PLACE_M, _HEIGHT_M, _SIZE, _END_M = 0.15, 0.05, 0.08, 0.3
"""Standard deviations of a box's centre, of its height over the ground, of the logs of its sizes, and sideways of what
lies its length away: so the headings of people are rough, and those of buses exact."""


@dataclass(frozen=True, slots=True, eq=False)
class MovedBoxes:
    """Two sweeps around N boxes, and the boxes' motions.

    Attributes:
        sweeps: the sweeps.
        motion: (N, 2) velocities along the boxes and to their left, m/s.
    """

    sweeps: BoxSweeps
    motion: Tensor


def moved_boxes(points: Points, boxes: Floats, velocity: Floats, rng: np.random.Generator) -> MovedBoxes:
    """Draw inexact boxes, half of them backwards, and count the sweeps around them.

    Args:
        points: (P, 5) of both sweeps.
        boxes: (N, 7) true boxes in the points' frame.
        velocity: (N, 2) m/s over ground.
        rng: source of the errors.
    """
    error, rough = rng.standard_normal((len(boxes), 7)), boxes.copy()
    rough[:, :3] += error[:, :3] * [_PLACE_M, _PLACE_M, _HEIGHT_M]
    rough[:, 3:6] *= np.exp(_SIZE * error[:, 3:6])
    rough[:, 6] += error[:, 6] * _END_M / boxes[:, 3] + np.pi * (rng.random(len(boxes)) < 0.5)
    motion = over_ground(velocity, -rough[:, 6])  # from the ground's axes to the box's
    return MovedBoxes(box_sweeps(points, rough), torch.from_numpy(motion.astype(np.float32)))


def join_moved(parts: Sequence[MovedBoxes]) -> MovedBoxes:
    """Join the boxes of samples into those of a batch."""
    sweeps = BoxSweeps(*(torch.cat([getattr(each.sweeps, name) for each in parts]) for name in ("counts", "cell_m_s")))
    return MovedBoxes(sweeps, torch.cat([each.motion for each in parts]))
