"""A road's surface: places (s, t) along and across its reference line, in three dimensions.

Height is the elevation, plus what superelevation, crossfall (until 1.5) and lateral shapes add across the road.
Superelevation turns the cross-section about the reference line: what lies at t comes to t cos(angle), and rises by
t sin(angle).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from coopsim.data.maps.elements import Element, numbers
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.plan_view import PlanView
from coopsim.data.maps.opendrive.records import Cubics, index_of
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

_ACROSS = 1e5
"""More than any t: shapes are sorted by section and t in one number."""


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Lateral shapes: cubics of t for some s, between which heights are interpolated.

    Attributes:
        s: (J,) places with a shape, rising.
        keys: (N,) `j * 2 _ACROSS + t` of each record, rising.
        t: (N,) where each record starts.
        factors: (N, 4).
    """

    s: Floats
    keys: Floats
    t: Floats
    factors: Floats

    @classmethod
    def read(cls, elements: list[Element]) -> Self:
        """Read `<shape>` records."""
        if not elements:
            return cls(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 4)))
        rows = numbers(elements, ("s", "t", "a", "b", "c", "d"), 0.0)
        s, place = np.unique(rows[:, 0], return_inverse=True)
        keys = np.asarray(place * (2.0 * _ACROSS) + np.clip(rows[:, 1], -_ACROSS / 2, _ACROSS / 2), np.float64)
        order = np.argsort(keys, kind="stable")
        return cls(s, keys[order], rows[order, 1], rows[order, 2:])

    def at(self, s: Floats, t: Floats, end: float) -> Floats:
        """Return heights (K,) over the plane of the road."""
        if not len(self.s):
            return np.zeros(len(s))
        before = index_of(self.s, s, end)
        after = np.minimum(before + 1, len(self.s) - 1)
        gap = np.where(after > before, self.s[after] - self.s[before], 1.0)
        share = np.where(after > before, np.clip((s - self.s[before]) / gap, 0.0, 1.0), 0.0)
        return (1.0 - share) * self._across(before, t) + share * self._across(after, t)

    def _across(self, place: Ints, t: Floats) -> Floats:
        first = np.searchsorted(self.keys, place * (2.0 * _ACROSS) - _ACROSS)
        wanted = place * (2.0 * _ACROSS) + np.clip(t, -_ACROSS / 2, _ACROSS / 2)
        index = np.maximum(np.searchsorted(self.keys, wanted, side="right") - 1, first)
        a, b, c, d = self.factors[index].T
        dt = np.maximum(t - self.t[index], 0.0)
        return np.asarray(a + dt * (b + dt * (c + dt * d)))


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A road's surface.

    Attributes:
        plan: its reference line.
        elevation: height along it.
        tilt: superelevation, rad.
        falls: crossfall to the left and right, rad.
        shapes: lateral shapes.
    """

    plan: PlanView
    elevation: Cubics
    tilt: Cubics
    falls: tuple[Cubics, Cubics]
    shapes: Shapes

    @classmethod
    def read(cls, road: Element, notes: Notes) -> Self:
        """Read plan view, elevation and lateral profile of a road."""
        falls = road.at_path("lateralProfile", "crossfall")
        return cls(
            PlanView.read(road, notes),
            Cubics.read(road.at_path("elevationProfile", "elevation")),
            Cubics.read(road.at_path("lateralProfile", "superelevation")),
            (
                Cubics.read([each for each in falls if each.get("side", "both") != "right"]),
                Cubics.read([each for each in falls if each.get("side", "both") != "left"]),
            ),
            Shapes.read(road.at_path("lateralProfile", "shape")),
        )

    def at(self, s: Floats, t: Floats, end: float = np.inf, level_t: Floats | None = None) -> Floats:
        """Return places (K, 3) m for s and t (K,); records that start at `end` do not count.

        Args:
            s: along the reference line.
            t: to the left of it.
            end: end of the section that is asked for.
            level_t: heights are those at these t: lanes that are `level` keep the height of their inner edge.
        """
        middle, ahead = self.plan.at(s, end)
        tilt = self.tilt.at(s, end)
        high_t = t if level_t is None else level_t
        height = self.elevation.at(s, end) + high_t * exact.sin(tilt) + self.shapes.at(s, high_t, end)
        if any(map(len, self.falls)):
            fall = np.where(high_t > 0.0, self.falls[0].at(s, end), self.falls[1].at(s, end))
            height = height - np.abs(high_t) * exact.tan(fall)
        across = t * exact.cos(tilt)
        x, y = middle[:, 0] - across * ahead[:, 1], middle[:, 1] + across * ahead[:, 0]
        return np.column_stack([x, y, height])

    def heading_at(self, s: float) -> float:
        """Return the direction of the reference line, rad."""
        _, ahead = self.plan.at(np.array([s]))
        return float(exact.arctan2(ahead[0, 1], ahead[0, 0]))
