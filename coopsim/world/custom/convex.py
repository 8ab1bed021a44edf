"""Convex outlines from a file."""

from __future__ import annotations

import numpy as np

from coopsim.config.entry import Entry
from coopsim.geometry.se3 import Floats


def read_convex(entry: Entry, advice: str = "write another shape as several") -> Floats:
    """Return the corners (K, 2) m of a convex outline, counter-clockwise.

    Args:
        entry: the list of corners, either way round.
        advice: what to do with other shapes, for the error.

    Raises:
        CoopsimError: of the entry's class: there are fewer than three corners, or they are not those of a convex shape.
    """
    outline = entry.points(3)
    edges = np.concatenate([outline[1:], outline[:1]]) - outline
    following = np.concatenate([edges[1:], edges[:1]])
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    once_round = abs(abs(_turned_rad(edges)) - 2 * np.pi) < 1e-6
    if not once_round or not ((turns > 0).all() or (turns < 0).all()):
        raise entry.error(f"outline must be convex, without corners of 180 degrees: {advice}")
    return outline if turns[0] > 0 else outline[::-1]


def _turned_rad(edges: Floats) -> float:
    """Return the total turn along closed edges (K, 2)."""
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    turn = np.concatenate([heading[1:], heading[:1]]) - heading
    return float(((turn + np.pi) % (2 * np.pi) - np.pi).sum())
