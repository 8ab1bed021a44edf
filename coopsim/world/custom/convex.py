"""Convex outlines from a file."""

from __future__ import annotations

import numpy as np

from coopsim.config.entry import Entry
from coopsim.geometry.se3 import Floats

_ROUNDING_M = 2e-3  # that a corner may lie inwards of its neighbours: coordinates are often whole millimetres


def read_convex(entry: Entry, advice: str = "write another shape as several") -> Floats:
    """Return the corners (K, 2) m of a convex outline, counter-clockwise.

    Args:
        entry: the list of corners, either way round.
        advice: what to do with other shapes, for the error.

    Raises:
        CoopsimError: of the entry's class: there are fewer than three corners, two in one place, or they are not those
            of a convex shape.
    """
    corners = entry.points(3)
    edges = np.concatenate([corners[1:], corners[:1]]) - corners
    following = np.concatenate([edges[1:], edges[:1]])
    length_m = np.hypot(edges[:, 0], edges[:, 1])
    if not length_m.all():
        raise entry.error("outline must have every corner once; the last is joined to the first anyway")
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    way = 1.0 if turns.sum() > 0 else -1.0
    across_m = np.hypot(*(edges + following).T)
    inwards_m = -way * turns / np.maximum(across_m, length_m)
    if abs(_turned_rad(edges) - way * 2 * np.pi) > 1e-6 or inwards_m.max() > _ROUNDING_M or not (turns * way > 0).any():
        raise entry.error(f"outline must be convex: {advice}")
    return corners if way > 0 else corners[::-1]


def _turned_rad(edges: Floats) -> float:
    """Return the total turn along closed edges (K, 2)."""
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    turn = np.concatenate([heading[1:], heading[:1]]) - heading
    return float(((turn + np.pi) % (2 * np.pi) - np.pi).sum())
