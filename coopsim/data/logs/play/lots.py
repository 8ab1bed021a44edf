"""Houses for a log without a map: where no road user of it ever goes, so that something hides something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.data.logs.track_log import TrackLog
from coopsim.geometry import exact
from coopsim.geometry.outlines import distances_to_lines
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Mask
from coopsim.world.places.layout import box_part
from coopsim.world.places.scenery import PAINTS
from coopsim.world.snapshot import StaticPart

CLEAR_M = 4.0
"""Least distance of a house from where the middle of any road user ever goes."""

_TRIES, _MOST = 400, 60
_FROM_M, _TO_M, _BETWEEN_M = 9.0, 35.0, 1.0  # from a way to a house's middle; between houses
_LONG_M, _DEEP_M, _HIGH_M = (9.0, 22.0), (8.0, 14.0), (5.0, 14.0)
_SAMPLE_M = 3.0  # between points of a house that are held against ways: below `CLEAR_M`, so none slips through


def drawn_lots(log: TrackLog, middle: Floats, radius_m: float, seed: int) -> tuple[list[StaticPart], list[Floats]]:
    """Draw houses within a radius beside the ways of a whole log, along them.

    Returns:
        their meshes and footprints (4, 2) m, in the frame whose origin is the `middle` (2,) m.
    """
    starts, ends, heading = _steps(log, middle, radius_m)
    rng = stream(seed, "log lots")
    found: list[Floats] = []
    for _ in range(_TRIES if len(starts) else 0):
        k, side = int(rng.integers(len(starts))), 1 if rng.random() < 0.5 else -1
        far, long, deep, high = (rng.uniform(*each) for each in ((_FROM_M, _TO_M), _LONG_M, _DEEP_M, _HIGH_M))
        aside = side * np.array([-exact.sin(heading[k]), exact.cos(heading[k])])
        house = np.array([*(starts[k] + far * aside), long, deep, heading[k], high])
        others = np.array(found).reshape(-1, 6)
        reach = (exact.norm(others[:, 2:4]) + exact.norm(house[None, 2:4])) / 2 + _BETWEEN_M
        if exact.norm(house[None, :2])[0] > radius_m or (exact.norm(others[:, :2] - house[:2]) < reach).any():
            continue
        if (distances_to_lines(_samples(house), starts, ends, np.zeros(len(starts))) > CLEAR_M).all():
            found.append(house)
        if len(found) == _MOST:
            break
    return [_mesh(house, k) for k, house in enumerate(found)], [_placed(house, _CORNERS) for house in found]


_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def _steps(log: TrackLog, middle: Floats, radius_m: float) -> tuple[Floats, Floats, Floats]:
    """Return the steps of all road users near a place, whose ends (M, 2) m differ by a metre or more, and headings."""
    place = log.place[:, :2] - middle
    near: Mask = (exact.norm(place[:-1]) < radius_m + _TO_M) & (log.track[1:] == log.track[:-1])
    rows = np.flatnonzero(near)
    ends = np.column_stack([place[rows], place[rows + 1]])
    _, first = np.unique(np.round(ends).astype(np.int64), axis=0, return_index=True)
    return ends[first, :2], ends[first, 2:], log.heading[rows[first]]


def _samples(house: Floats) -> Floats:
    """Return points (N, 2) m all over a house."""
    along, across = (np.linspace(-0.5, 0.5, int(np.ceil(size / _SAMPLE_M)) + 1) for size in house[2:4])
    return _placed(house, np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2))


def _placed(house: Floats, shares: Floats) -> Floats:
    """Return places (N, 2) m of shares (N, 2) of a house's length and depth from its middle."""
    x, y = (shares * house[2:4]).T
    cos, sin = exact.cos(house[4]), exact.sin(house[4])
    return np.column_stack([house[0] + cos * x - sin * y, house[1] + sin * x + cos * y])


def _mesh(house: Floats, number: int) -> StaticPart:
    part = box_part("building", (-0.5, -0.5, 0.0), (0.5, 0.5, float(house[5])), PAINTS[number % len(PAINTS)])
    return replace(part, vertices=np.column_stack([_placed(house, part.vertices[:, :2]), part.vertices[:, 2]]))
