"""A road map as a bitmap, so that the surroundings of any pose are looked up and not drawn again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from coopsim.geometry.se3 import Floats
from coopsim.world.snapshot import RoadMap

LAYERS = ("lanes", "crosswalks", "pavements", "buildings", "markings")
"""Fields of a `RoadMap`; layer k is bit k of a cell."""

_MOST_CELLS = 64_000_000


@dataclass(frozen=True, slots=True, eq=False)
class MapRaster:
    """A bitmap of a road map in the world frame.

    Attributes:
        cells: (H, W) uint8, a bit for each of `LAYERS`; row and column grow with y and x.
        origin_m: (2,) x, y of the outer corner of the first cell.
        cell_m: size of a cell.
    """

    cells: NDArray[np.uint8]
    origin_m: Floats
    cell_m: float

    @classmethod
    def of(cls, road_map: RoadMap, cell_m: float) -> MapRaster:
        """Draw a map in cells of this size, or larger ones where the map would have too many."""
        outlines = [outline for layer in LAYERS for outline in getattr(road_map, layer)]
        if not outlines:
            return cls(np.zeros((1, 1), np.uint8), np.zeros(2), cell_m)
        corners = np.concatenate(outlines)
        origin, extent = corners.min(axis=0), np.maximum(np.ptp(corners, axis=0), cell_m)
        cell_m = max(cell_m, math.sqrt(float(extent.prod()) / _MOST_CELLS))
        width, height = (np.floor(extent / cell_m).astype(int) + 1).tolist()
        cells = np.zeros((height, width), np.uint8)
        for bit, layer in enumerate(LAYERS):
            picture = Image.new("1", (width, height))
            draw = ImageDraw.Draw(picture)
            for outline in getattr(road_map, layer):
                draw.polygon([(x, y) for x, y in ((outline - origin) / cell_m).tolist()], fill=1)
            cells |= np.asarray(picture, np.uint8) << bit
        return cls(cells, origin, cell_m)
