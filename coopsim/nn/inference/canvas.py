"""Cells of the world on which maps of features lie, around an agent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.nn.detector.encoder import COARSEST, STRIDE
from coopsim.types import BevGrid

REACH_M = 76.8
"""Half the edge of the square that an agent's map covers."""


def way_to_world_cells(position_m: Floats, cell_m: float) -> Floats:
    """Return the way from an agent at (2,) m to the nearest corner of the world's coarse cells, (2,) m, in the world's
    axes.

    On cells of the world, the maps of all agents have the same cells: a warp copies, and blurs nothing. The cells are
    those of the encoder's coarsest scale, so that its finer ones are alike, too. `cell_m` is the edge of a cell of
    features.
    """
    step_m = COARSEST / STRIDE * cell_m
    way: Floats = step_m * np.round(position_m / step_m) - position_m
    return way


def compass_region(
    region_m: tuple[float, float], heading_rad: float, cell_m: float, corner_m: Sequence[float] | Floats = (0.0, 0.0)
) -> BevGrid:
    """Return the cells around a region |x| <= X, |y| <= Y of an agent's base frame, in axes in which it is turned.

    Args:
        region_m: X and Y.
        heading_rad: the agent's heading in those axes.
        cell_m: edge of a cell.
        corner_m: (2,) a corner of coarse cells, seen from the agent, see `way_to_world_cells`.
    """
    cos, sin = abs(np.cos(heading_rad)), abs(np.sin(heading_rad))
    extents = (cos * region_m[0] + sin * region_m[1], sin * region_m[0] + cos * region_m[1])
    step_m = COARSEST / STRIDE * cell_m
    sides = []
    for extent_m, start_m in zip(extents, corner_m, strict=True):
        low, high = -np.ceil((extent_m + start_m) / step_m - 1e-9), np.ceil((extent_m - start_m) / step_m - 1e-9)
        sides.append((start_m + step_m * float(low), start_m + step_m * float(high)))
    return BevGrid(sides[0], sides[1], cell_m)


def canvas_around(position_m: Floats, cell_m: float) -> BevGrid:
    """Return an encoder's canvas around an agent at (2,) m, on the world's cells; `cell_m` is the edge of the canvas'
    cells.
    """
    reach_m = cell_m * COARSEST * round(REACH_M / cell_m / COARSEST)
    x_m, y_m = way_to_world_cells(position_m, STRIDE * cell_m)
    return BevGrid((x_m - reach_m, x_m + reach_m), (y_m - reach_m, y_m + reach_m), cell_m)
