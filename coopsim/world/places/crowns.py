"""Crowns of trees from above, for pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.snapshot import StaticPart

_DIAGONAL = math.sqrt(0.5)
_HALF = np.array([[1.0, 0.0], [_DIAGONAL, _DIAGONAL], [0.0, 1.0], [-_DIAGONAL, _DIAGONAL]])
_OCTAGON = np.concatenate([_HALF, -_HALF])


def crowns_of(parts: Iterable[StaticPart]) -> tuple[Floats, ...]:
    """Return the outlines (8, 2) m of the crowns of trees among the parts of a place."""
    leaves = [part for part in parts if part.name == "leaves" or (part.name == "tree" and part.opacity < 1)]
    ends = [(part.vertices[:, :2].min(axis=0), part.vertices[:, :2].max(axis=0)) for part in leaves]
    return tuple((low + high) / 2 + (high - low) / 2 * _OCTAGON for low, high in ends)
