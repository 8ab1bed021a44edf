"""Spaces that observations and actions share."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

COUNTER = 2**62
"""Limit of counters (nanoseconds, ids): it fits an int64 and leaves room to add."""


def real_space(*shape: int, low: float = -np.inf, dtype: Any = np.float64) -> spaces.Box:
    """Return a space of arrays of this shape, bounded by `low` below."""
    return spaces.Box(low, np.inf, shape, dtype)


def rows_space(**columns: spaces.Space[Any]) -> spaces.Sequence:
    """Return a space of any number of rows, as a dict of stacked columns."""
    return spaces.Sequence(spaces.Dict(columns), stack=True)


def box_space() -> spaces.Box:
    """Return a new space of boxes: x, y, z, l, w, h, yaw; sizes are positive.

    A space is never shared: it would be seeded once for all its uses.
    """
    return spaces.Box(np.array([-np.inf] * 3 + [0.0] * 3 + [-np.inf]), np.full(7, np.inf), dtype=np.float64)
