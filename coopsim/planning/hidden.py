"""Places that nobody sees, in two dimensions."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Mask


def sides(boxes: Floats) -> Floats:
    """Return the sides (4 N, 4), x and y of both ends, of boxes (N, 7) from above, m."""
    along = np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])], axis=1) * boxes[:, 3:4] / 2
    aside = np.stack([-np.sin(boxes[:, 6]), np.cos(boxes[:, 6])], axis=1) * boxes[:, 4:5] / 2
    corners = boxes[:, None, :2] + np.stack([along + aside, aside - along, -along - aside, along - aside], axis=1)
    return np.concatenate([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 4)


@njit(cache=True, nogil=True)
def hidden(places: Floats, eyes: Floats, cover: Floats, boxes: Floats, sees_m: float) -> Mask:
    """Return the mask (P,) of places that no eye sees, except those within a box, where nobody can be.

    Args:
        places: (P, 2) m.
        eyes: (V, 2) m.
        cover: (S, 4) x and y of both ends, m, of what hides.
        boxes: (N, 7) bodies.
        sees_m: distance up to which an eye sees.
    """
    out = np.zeros(len(places), np.bool_)
    for p in range(len(places)):
        x, y = places[p]
        seen = _is_within(x, y, boxes)
        for v in range(len(eyes)):
            if seen:
                break
            near = (eyes[v, 0] - x) ** 2 + (eyes[v, 1] - y) ** 2 <= sees_m**2
            seen = near and not _is_cut(x, y, eyes[v, 0], eyes[v, 1], cover)
        out[p] = not seen
    return out


@njit(cache=True, nogil=True)
def _is_within(x: float, y: float, boxes: Floats) -> bool:
    for k in range(len(boxes)):
        cos, sin = np.cos(boxes[k, 6]), np.sin(boxes[k, 6])
        dx, dy = x - boxes[k, 0], y - boxes[k, 1]
        if abs(cos * dx + sin * dy) < boxes[k, 3] / 2 and abs(cos * dy - sin * dx) < boxes[k, 4] / 2:
            return True
    return False


@njit(cache=True, nogil=True)
def _is_cut(x: float, y: float, to_x: float, to_y: float, cover: Floats) -> bool:
    """Return whether a side cuts the line between two places."""
    dx, dy = to_x - x, to_y - y
    for a_x, a_y, b_x, b_y in cover:
        if max(a_x, b_x) < min(x, to_x) or min(a_x, b_x) > max(x, to_x):
            continue
        one = dx * (a_y - y) - dy * (a_x - x)
        other = dx * (b_y - y) - dy * (b_x - x)
        if (one > 0) == (other > 0):
            continue
        side_x, side_y = b_x - a_x, b_y - a_y
        before = side_x * (y - a_y) - side_y * (x - a_x)
        after = side_x * (to_y - a_y) - side_y * (to_x - a_x)
        if (before > 0) != (after > 0):
            return True
    return False
