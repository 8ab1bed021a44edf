"""Outlines: the smallest rectangle around a crossing, and the line along its middle; circles of trees and poles."""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

_ALIKE = 1.3
"""Sides that differ by less than this factor do not tell which way people go: then they go across the road."""
_CORNERS = 12


def circle(radius_m: float) -> Floats:
    """Return the corners (12, 3) m of a circle around the origin."""
    angles = np.arange(_CORNERS) * (2 * math.pi / _CORNERS)
    return radius_m * np.column_stack([exact.cos(angles), exact.sin(angles), np.zeros(_CORNERS)])


def along_rectangle(outline: Floats, road_rad: float) -> tuple[Floats, float]:
    """Return the line (2, 3) from side to side of a crossing with an outline (K, 3), and its width, m.

    People go along the longer side of the smallest rectangle, or across the road of heading `road_rad`.
    """
    closed = np.concatenate([outline, outline[:1]])
    edges = np.diff(closed[:, :2], axis=0)
    lengths = exact.norm(edges)
    axes = edges[lengths > 1e-6] / lengths[lengths > 1e-6, None]
    if not len(axes):
        axes = np.array([[1.0, 0.0]])
    sides = np.stack([axes, np.column_stack([-axes[:, 1], axes[:, 0]])])  # (2, E, 2)
    spans = exact.dot(outline[None, None, :, :2], sides[:, :, None, :])  # (2, E, K)
    extents = spans.max(axis=2) - spans.min(axis=2)
    best = int(np.argmin(extents[0] * extents[1]))
    size, frame = extents[:, best], sides[:, best]
    across = np.abs(exact.dot(frame, np.array([-exact.sin(road_rad), exact.cos(road_rad)])))
    longer = int(np.argmax(size)) if size.max() > _ALIKE * size.min() else int(np.argmax(across))
    middle = ((spans.max(axis=2) + spans.min(axis=2)) / 2)[:, best]
    centre = middle[0] * frame[0] + middle[1] * frame[1]
    half = frame[longer] * size[longer] / 2
    height = float(outline[:, 2].mean())
    return np.column_stack([[centre - half, centre + half], [height, height]]), float(size[1 - longer])
