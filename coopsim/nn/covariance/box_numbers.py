"""Inputs of the covariance network for a box: its place, seen by the receiver and by the sensor that detected it."""

from __future__ import annotations

import numpy as np

from coopsim.fusion.fused_boxes import clear_middle
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Ints

NUMBERS = 19
"""The 18 of DMSTrack, and the score."""

ANGLES = (3, 11, 16)
"""Columns in rad."""

SHORT = (2, 4, 5, 6, 10, 15)
"""Columns of heights and sizes, m; the other lengths are distances on the ground."""

SCORE = 18

_LARGEST = 1e6  # larger ones, which nobody detects, would not be finite as float32


def box_numbers(boxes: Floats, score: Floats, group: Ints, sensors: Floats) -> Floats:
    """Return the numbers (N, 19) of boxes: 18 as in DMSTrack (Chiu et al., ICRA 2024), and the score.

    In order: x, y, z, yaw, l, w, h; distance on the ground; the sensor's x, y, z, yaw, distance; and the box's x, y, z,
    yaw, distance in the sensor's frame.

    Args:
        boxes: (N, 7) x, y, z, l, w, h, yaw in the receiver's base frame.
        score: (N,).
        group: (N,) number of the agent that detected each box.
        sensors: (G, 4) x, y, z m and heading rad of each agent in the same frame. A row of NaN: its place is not known;
            it is taken to be in the middle of what the agent sees clearly, at height 0, with the receiver's heading.
    """
    known = sensors.copy()
    for number in np.flatnonzero(~np.isfinite(sensors).all(axis=1)):
        rows = group == number
        known[number] = 0.0
        known[number, :2] = clear_middle(np.ascontiguousarray(boxes[rows]), np.ascontiguousarray(score[rows]))
    sensor = known[group]
    x, y = boxes[:, 0] - sensor[:, 0], boxes[:, 1] - sensor[:, 1]
    cos, sin = np.cos(sensor[:, 3]), np.sin(sensor[:, 3])
    columns = (
        *boxes[:, [0, 1, 2, 6, 3, 4, 5]].T,
        np.hypot(boxes[:, 0], boxes[:, 1]),
        *sensor.T,
        np.hypot(sensor[:, 0], sensor[:, 1]),
        cos * x + sin * y,
        cos * y - sin * x,
        boxes[:, 2] - sensor[:, 2],
        wrap_angle(boxes[:, 6] - sensor[:, 3]),
        np.hypot(x, y),
        score,
    )
    numbers: Floats = np.clip(np.stack(columns, axis=1), -_LARGEST, _LARGEST)
    return numbers


def own_numbers(boxes: Floats, score: Floats) -> Floats:
    """Return the numbers (N, 19) of an agent's own boxes (N, 7), in its base frame, with their scores (N,)."""
    return box_numbers(boxes, score, np.zeros(len(boxes), np.int64), np.zeros((1, 4)))
