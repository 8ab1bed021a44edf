"""The lanes of a street in one direction, piece by piece."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.plan import LANE_M, Station, Street, Stretch

LanePlace = tuple[int, float]
"""A lane's number, and `along_m` of its street."""


@dataclass(frozen=True, slots=True)
class LanePiece:
    """A piece of a lane.

    Attributes:
        begin: lane and place.
        end: the same; of another lane where this one splits off, or joins.
        stretch: number of the street's stretch that it is on.
        joins: whether two pieces end there, so that vehicles may wait at the beginning.
    """

    begin: LanePlace
    end: LanePlace
    stretch: int
    joins: bool = False


class Carriageway:
    """All lanes of a street in one direction.

    Args:
        street: the street.
        forwards: whether vehicles go from its beginning to its end.

    Attributes:
        stations: cross-sections, in the direction of travel.
        sign: of `aside_m` of the lanes.
    """

    def __init__(self, street: Street, forwards: bool) -> None:
        self.street, self.forwards, self.sign = street, forwards, -1.0 if forwards else 1.0
        self.stations = street.stations if forwards else street.stations[::-1]
        self._places = [station.along_m for station in street.stations]
        self._inner_m = [station.inner_m for station in street.stations]
        self._first = np.cumsum([0.0, *(stretch.length_m for stretch in street.line)]).tolist()

    def pieces(self) -> list[LanePiece]:
        """Return the pieces of all lanes."""
        found = list[LanePiece]()
        for lane in range(max(station.lanes for station in self.stations)):
            for before, after in pairwise(self.stations):
                if before.lanes == lane + 1 == after.lanes + 1:
                    found.append(self._piece((lane, before.along_m), (lane - 1, after.along_m), joins=True))
                elif before.lanes + 1 == lane + 1 == after.lanes:
                    found.append(self._piece((lane - 1, before.along_m), (lane, after.along_m)))
            for run in self._runs(lane):
                cuts = self._cuts(lane, run)
                found += [
                    self._piece((lane, a), (lane, b), joins=self._is_joined(lane, a, b)) for a, b in pairwise(cuts)
                ]
        return found

    def place(self, at: LanePlace) -> Floats:
        """Return a place (2,) m in the middle of a lane."""
        return np.asarray(self.street.position(at[1], self.aside_m(at))[0])

    def aside_m(self, at: LanePlace) -> float:
        """Return the distance of a lane's middle to the left of the street's centre line."""
        inner_m = float(np.interp(at[1], self._places, self._inner_m))
        return self.sign * (inner_m + at[0] * LANE_M)

    def stretch(self, piece: LanePiece) -> Stretch:
        """Return the stretch that a piece is on."""
        return self.street.line[piece.stretch]

    def centre(self, piece: LanePiece) -> Floats:
        """Return the middle (2,) m of an arc."""
        radius = 1 / self.stretch(piece).curvature_1_m
        return np.asarray(self.street.position(self._first[piece.stretch], radius)[0])

    def _piece(self, begin: LanePlace, end: LanePlace, *, joins: bool = False) -> LanePiece:
        middle = (begin[1] + end[1]) / 2
        return LanePiece(begin, end, int(np.searchsorted(self._first, middle, side="right")) - 1, joins)

    def _runs(self, lane: int) -> list[list[Station]]:
        """Return the cross-sections where a lane is there, for each part of the street where it is."""
        runs = list[list[Station]]([[]])
        for station in self.stations:
            if station.lanes > lane:
                runs[-1].append(station)
            elif runs[-1]:
                runs.append([])
        return [run for run in runs if len(run) > 1]

    def _cuts(self, lane: int, run: list[Station]) -> list[float]:
        """Return where pieces of a lane begin and end."""
        cuts = {run[0].along_m, run[-1].along_m}
        for before, after in pairwise(run):
            if before.inner_m != after.inner_m or self._is_joined(lane, before.along_m, after.along_m):
                cuts |= {before.along_m, after.along_m}
            elif lane + 1 == before.lanes < after.lanes:  # another lane splits off
                cuts.add(before.along_m)
        low, high = sorted((run[0].along_m, run[-1].along_m))
        cuts |= {joint for joint in self._first if low < joint < high}
        return sorted(cuts, reverse=not self.forwards)

    def _is_joined(self, lane: int, begin_m: float, end_m: float) -> bool:
        """Return whether the next lane joins a lane between two places."""
        for before, after in pairwise(self.stations):
            if (before.along_m, after.along_m) == (begin_m, end_m):
                return before.lanes == lane + 2 == after.lanes + 1
        return False
