"""Small things beside roads, as many as along real streets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.furniture.free_ground import GROUND, are_free, obstacles_of
from coopsim.world.furniture.furnish import furnishing_parts
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.places.description import MapFurniture, point_of
from coopsim.world.places.layout import Layout

# Real streets have several times as many small things as drawn ones, by the clusters that the page counts.
_SMALL = ("bollard", "marker", "hydrant", "sign", "bin", "mailbox", "cabinet", "planter", "heap", "bush", "bush")
_LEAST_M, _LARGEST = 0.6, {"height_m": 3.0, "width_m": 2.0}
_PIECES_PER_M, _BESIDE_M, _PIECE_M, _LONGEST_M = (0.0, 0.8), (0.6, 12.0), 0.4, 500.0


def cluttered(layout: Layout, rng: np.random.Generator) -> Layout:
    """Return a layout with more small things beside its roads, where nothing stands, drives or walks."""
    lanes = list(layout.network.lanes.values())
    length_m = np.array([lane.length for lane in lanes]).clip(max=_LONGEST_M)
    count = int(rng.uniform(*_PIECES_PER_M) * length_m.sum())
    chosen = rng.choice(len(lanes), count, p=length_m / length_m.sum())
    side = rng.choice((-1.0, 1.0), count)
    spots = np.array(
        [
            lanes[k].position(rng.random() * length_m[k], left * (lanes[k].width / 2 + rng.uniform(*_BESIDE_M)))
            for k, left in zip(chosen, side, strict=True)
        ]
    ).reshape(-1, 2)
    area = np.stack([spots.min(axis=0), spots.max(axis=0)]) if count else np.zeros((2, 2))
    spots = spots[are_free(spots, _PIECE_M, GROUND, obstacles_of(layout, area))]
    heights = None if layout.relief is None else layout.relief.heights
    pieces = furnishing_parts([_piece(spot, rng) for spot in spots], heights)
    return replace(layout, furnishing=(*layout.furnishing, *pieces))


def _piece(spot: Floats, rng: np.random.Generator) -> MapFurniture:
    """Draw a piece of furniture, with sizes of which there are few, so that most pieces share a mesh."""
    kind = _SMALL[int(rng.integers(len(_SMALL)))]
    sizes: dict[str, Any] = {
        name: float(np.round(rng.uniform(max(size.least, _LEAST_M), min(size.most, _LARGEST[name])), 1))
        for name, size in KINDS[kind].sizes.items()
    }
    return MapFurniture(kind, point_of(spot), float(rng.uniform(0.0, 360.0)), **sizes)
