"""Painted lines between lanes: thin, flat, and bright for LiDARs."""

from __future__ import annotations

from coopsim.world.places.layout import MARKING, Layout, flat_part
from coopsim.world.relief.draping import laid_on
from coopsim.world.snapshot import StaticPart

_PAINT_M = 0.012  # over the road, more than water and stripes
_REFLECTIVITY = 0.8  # as of crosswalks; road paint has glass beads


def lane_paint(layout: Layout) -> tuple[StaticPart, ...]:
    """Build the lines that a place's map has between its lanes, on its own ground; none where it has none."""
    if not layout.road_map.markings:
        return ()
    flat = flat_part("marking", list(layout.road_map.markings), 2 * _PAINT_M, MARKING, _REFLECTIVITY)
    return (flat,) if layout.relief is None else (laid_on(flat, layout.relief.grid, _PAINT_M),)
