"""Heights of a place's ground, from those of a map's lanes."""

from __future__ import annotations

import numpy as np

from coopsim.data.maps.place.lines import spaced
from coopsim.data.maps.street_map import DRIVEN, StreetMap

APART_M = 8.0
"""Distance between the places whose heights are kept: of all within a square of this size the mean counts."""

_FLAT_M = 0.2  # ground that rises by less is flat
_DECIMALS = 3


def heights_of(streets: StreetMap) -> tuple[tuple[float, float, float], ...]:
    """Return the field `heights` of the description of a place from a map that is cut out: x, y and z, m.

    They are those of the driven lanes and of the ways over junctions, about 8 m apart, with the lowest at 0; empty
    where the map is flat. The cut must have one level: where lanes cross in height (`coopsim.data.maps.levels`), the
    ground would be at the mean of both.
    """
    lines = [lane.line for lane in streets.lanes.values() if lane.kind in DRIVEN]
    lines += [way.line for way in streets.ways.values()]
    if not lines:
        return ()
    points = np.concatenate([spaced(line, APART_M / 2) for line in lines])
    if np.ptp(points[:, 2]) < _FLAT_M:
        return ()
    square = np.floor(points[:, :2] / APART_M).astype(np.int64)
    _, own = np.unique(square, axis=0, return_inverse=True)
    own = own.reshape(-1)
    counts = np.bincount(own)
    means = np.column_stack([np.bincount(own, points[:, axis]) / counts for axis in range(3)])
    means[:, 2] -= means[:, 2].min()
    return tuple((x, y, z) for x, y, z in (np.round(means, _DECIMALS) + 0.0).tolist())
