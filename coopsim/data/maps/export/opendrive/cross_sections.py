"""Cross-sections of a street: lanes of all kinds on both sides, whose widths change evenly within a section."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from coopsim.data.maps.export.parking_strips import Strips
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.plan import LANE_M, Street

PAVEMENT_M = 4.1
"""Width of a pavement: people walk 2.6 m from the kerb, on 3 m."""

ANY_M = 1e-6
"""Lanes that are wider are there."""

_CLOSE_M = 0.5  # sections are not shorter, except those between stations


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Part of a road with the same lanes, from `start` to `end` (m from the road's beginning).

    `widths` has lanes by the direction of the side that they are on (True: along the road), then by name, from the
    middle outwards: their width at both ends. Names are `median`, `drive0`, `drive1`, `drive2`, `park` and `walk`.
    """

    start: float
    end: float
    widths: Mapping[bool, Mapping[str, tuple[float, float]]]

    def number(self, forwards: bool, name: str) -> int:
        """Return the place of a lane from the middle outwards, from 1; 0: there is no such lane."""
        names = list(self.widths.get(forwards, ()))
        return names.index(name) + 1 if name in names else 0


def sections_of(street: Street, strips: Strips) -> list[Section]:
    """Return the cross-sections of a street from its first lanes to its last."""
    knots = _knots(street, strips)
    sides = {forwards: _widths(street, knots, strips[street.number, forwards]) for forwards in (True, False)}
    return [
        Section(float(begin - knots[0]), float(end - knots[0]), {way: _there(side, k) for way, side in sides.items()})
        for k, (begin, end) in enumerate(pairwise(knots))
    ]


def _there(widths: Mapping[str, Floats], k: int) -> dict[str, tuple[float, float]]:
    """Return the lanes that have a width between the places k and k + 1."""
    ends = {name: (float(width[k]), float(width[k + 1])) for name, width in widths.items()}
    return {name: pair for name, pair in ends.items() if max(pair) > ANY_M}


def one_lane(length_m: float, width_m: float, *, kerbed: bool) -> Section:
    """Return the cross-section of a road of one lane, with a pavement on its outer side or not."""
    widths = {"drive0": width_m} | ({"walk": PAVEMENT_M} if kerbed else {})
    return Section(0.0, length_m, {True: {name: (width, width) for name, width in widths.items()}})


def _knots(street: Street, strips: Strips) -> Floats:
    """Return the places along a street at which the change of its cross-section changes."""
    stations = [station.along_m for station in street.stations]
    more = np.concatenate([strips[street.number, forwards][0] for forwards in (True, False)])
    kept = list(stations)
    for at in np.sort(more).tolist():
        if stations[0] < at < stations[-1] and min(abs(at - each) for each in kept) > _CLOSE_M:
            kept.append(at)
    return np.sort(np.array(kept))


def _widths(street: Street, along: Floats, strip: tuple[Floats, Floats]) -> dict[str, Floats]:
    """Return the widths (K,) of all lanes of one side at places (K,) along a street."""
    places = [station.along_m for station in street.stations]
    inner = np.interp(along, places, [station.inner_m for station in street.stations])
    # Lanes beside the centre line overlap by 0.15 m in the plan; here they end at the line.
    edge, half = np.maximum(inner - LANE_M / 2, 0.0), street.half_m(along)
    found = {"median": edge}
    for lane in range(max(station.lanes for station in street.stations)):
        outer = np.clip(inner + (lane + 0.5) * LANE_M, edge, half)
        found[f"drive{lane}"], edge = outer - edge, outer
    return found | {"park": np.interp(along, *strip), "walk": np.full(len(along), PAVEMENT_M)}
