"""A street as edges of SUMO: cut where lanes split or join, and at crosswalks between junctions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from coopsim.data.maps.export.town_network import LaneEnd, TownNetwork
from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.plan import LANE_M, Street

WALK_M = 3.0
"""Width of a lane for people."""

_TO_WALK_M = 2.6  # from the kerb
_STEP_M, _STRAIGHT_M = 1.0, 0.005
_HALF_CROSSWALK_M = 3.0

Strip = tuple[Floats, Floats]


@dataclass(frozen=True, slots=True)
class Break:
    """Part of a street that is a junction: where lanes split or join, or at a crosswalk (`crosswalk`: its number)."""

    begin_m: float
    end_m: float
    crosswalk: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StreetEdges:
    """Edges of a street: `s3f0`, `s3f1` ... along it, and `s3b0`, `s3b1` ... back, by the number of their run.

    Attributes:
        town: all roads.
        street: the street.
        breaks: junctions between runs, in order.
        strips: parking strips, by the direction of the lanes beside them.
    """

    town: TownNetwork
    street: Street
    breaks: tuple[Break, ...]
    strips: Mapping[bool, Strip]

    @property
    def runs(self) -> list[tuple[float, float]]:
        """Return where edges begin and end, m along the street."""
        first, last = self.street.span_m
        ends = [first, *(at for each in self.breaks for at in (each.begin_m, each.end_m)), last]
        return list(zip(ends[::2], ends[1::2], strict=True))

    def edge(self, run: int, forwards: bool) -> str:
        """Return the name of an edge."""
        return f"s{self.street.number}{'f' if forwards else 'b'}{run}"

    def ends(self) -> list[str]:
        """Return the names of the junctions before, between and behind all runs."""
        between = [f"s{self.street.number}n{k}" for k in range(len(self.breaks))]
        begin, end = (self.town.junction_at(self.street, end) for end in (self.street.begin, self.street.end))
        return [begin, *between, end]

    def lanes(self, run: int) -> int:
        """Return the number of lanes for vehicles of a run, in each direction."""
        middle = sum(self.runs[run]) / 2
        return max(
            min(before.lanes, after.lanes)
            for before, after in pairwise(self.street.stations)
            if before.along_m <= middle <= after.along_m
        )

    def place_of(self, lane: LaneEnd, *, leaves: bool) -> tuple[str, int]:
        """Return the edge and the number of its lane where a way leaves a lane or comes to it."""
        run = len(self.breaks) if lane.forwards == leaves else 0
        return self.edge(run, lane.forwards), self.lanes(run) - lane.lane

    def line(self, forwards: bool, begin: tuple[float, int], end: tuple[float, int]) -> Floats:
        """Return the middle (K, 2) m of a lane from a place along the street to another, each with the lane's number.

        The numbers differ where a lane splits off or joins.
        """
        along = self._along(begin[0], end[0])
        number = np.linspace(begin[1], end[1], len(along))
        return self._world(along, self._inner_m(along) + number * LANE_M, forwards)

    def walk(self, forwards: bool, begin_m: float, end_m: float) -> Floats:
        """Return the middle (K, 2) m of people's way beside the street, in the direction of travel."""
        along = self._along(begin_m, end_m)
        strip_m = np.interp(along, *self.strips[forwards])
        return self._world(along, self.street.half_m(along) + strip_m + _TO_WALK_M, forwards)

    def _along(self, begin_m: float, end_m: float) -> Floats:
        return np.linspace(begin_m, end_m, max(2, int(abs(end_m - begin_m) / _STEP_M) + 1))

    def _inner_m(self, along: Floats) -> Floats:
        stations = self.street.stations
        places, inner_m = [station.along_m for station in stations], [station.inner_m for station in stations]
        return np.asarray(np.interp(along, places, inner_m))

    def _world(self, along: Floats, aside_m: ArrayLike, forwards: bool) -> Floats:
        line = self.town.place(self.street.position(along, np.asarray(aside_m) * (-1.0 if forwards else 1.0)))
        return np.asarray(line[keep_corners(np.ascontiguousarray(line), _STRAIGHT_M)])


def breaks_of(street: Street, crosswalks: Iterable[tuple[int, float]]) -> tuple[Break, ...]:
    """Return the breaks of a street, with crosswalks between junctions, by number and place along the street."""
    tapers = [
        Break(before.along_m, after.along_m)
        for before, after in pairwise(street.stations)
        if before.lanes != after.lanes
    ]
    zebras = [Break(at - _HALF_CROSSWALK_M, at + _HALF_CROSSWALK_M, number) for number, at in crosswalks]
    return tuple(sorted([*tapers, *zebras], key=lambda each: each.begin_m))
