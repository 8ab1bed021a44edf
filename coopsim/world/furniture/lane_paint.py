"""Painted lines between lanes: thin, flat, and bright for LiDARs."""

from __future__ import annotations

import numpy as np

from coopsim.world.places.layout import MARKING, Layout, flat_part
from coopsim.world.relief.draping import drape
from coopsim.world.snapshot import StaticPart

_PAINT_M = 0.012  # over the road, more than water and stripes
_REFLECTIVITY = 0.8  # as of crosswalks; road paint has glass beads


def lane_paint(layout: Layout) -> tuple[StaticPart, ...]:
    """Build the lines that a place's map has between its lanes, on its own ground; none where it has none."""
    if not layout.road_map.markings:
        return ()
    flat = flat_part("marking", list(layout.road_map.markings), 2 * _PAINT_M, MARKING, _REFLECTIVITY)
    if layout.relief is None:
        return (flat,)
    laid = drape(np.ascontiguousarray(flat.vertices[flat.faces][..., :2]), layout.relief.grid)
    vertices = laid.reshape(-1, 3) + np.array([0.0, 0.0, _PAINT_M])
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return (StaticPart("marking", vertices, faces, MARKING, _REFLECTIVITY, closed=False),)
