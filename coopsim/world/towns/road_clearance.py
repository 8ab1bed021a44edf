"""Clearance of masts from the middles of lanes, as the reader of places asks for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.plan import LANE_M

_CLEAR_M = LANE_M / 2 + 0.02  # more than coordinates are rounded


def off_roads(
    masts: Iterable[Mapping[str, Any]], nodes: Mapping[str, Sequence[float]], roads: Iterable[Mapping[str, Any]]
) -> list[Mapping[str, Any]]:
    """Return the masts that stand on no lane: wide turns may pass nearer to a corner than its kerb.

    Args:
        masts: the key `rsus` of a description.
        nodes: the key `nodes`.
        roads: the key `roads`; loops and lines along further points are not looked at: no mast stands beside them.
    """
    feet = {k: (mast, np.asarray(mast["at"], dtype=np.float64)) for k, mast in enumerate(masts)}
    for road in roads:
        if "via" in road or road.get("turn") == "around":
            continue
        start, end = (np.asarray(nodes[road[name]], dtype=np.float64) for name in ("from", "to"))
        for k, (_, foot) in list(feet.items()):
            away_m = _from_arc(foot, road, start, end) if "centre" in road else _from_line(foot, start, end)
            if away_m < _CLEAR_M:
                del feet[k]
    return [mast for mast, _ in feet.values()]


def _from_line(foot: Floats, start: Floats, end: Floats) -> float:
    """Return the distance (m) of a place (2,) from a line between two."""
    along = end - start
    share = np.clip(exact.dot(foot - start, along) / exact.dot(along, along), 0.0, 1.0)
    return float(exact.hypot(*(foot - start - share * along)))


def _from_arc(foot: Floats, road: Mapping[str, Any], start: Floats, end: Floats) -> float:
    """Return the distance (m) of a place (2,) from a bend between two."""
    centre, sense = np.asarray(road["centre"], dtype=np.float64), 1.0 if road["turn"] == "left" else -1.0
    first, last, own = (exact.arctan2(*(each - centre)[::-1]) for each in (start, end, foot))
    passed, swept = (sense * (own - first)) % (2 * np.pi), (sense * (last - first)) % (2 * np.pi)
    if passed <= swept:
        return float(abs(exact.hypot(*(foot - centre)) - exact.hypot(*(start - centre))))
    return float(min(exact.hypot(*(foot - start)), exact.hypot(*(foot - end))))
