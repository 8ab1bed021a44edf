"""Junctions with lights as a roadside unit describes them: their geometry, and their phases at a moment."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.types.intersections import (
    HOUR_DS,
    UNKNOWN_MARK,
    IntersectionMap,
    MapLane,
    MovementPhase,
    SignalPhases,
)
from coopsim.types.units import NS_PER_S
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import Lane, LaneIndex, Road
from coopsim.world.places.signals import GIVE_WAY, PRIORITY, RED, YELLOW, Signal

APPROACH_M, EXIT_M = 100.0, 30.0
"""Length of the lanes that are described before stop lines, and behind the junction."""

_ACCURACY_M, _STEP_M, _MOST_POINTS = 0.1, 2.0, 63
_ROUNDING_S = 1e-6  # as in the program itself: times are sums of steps
_PHASES = {
    PRIORITY: MovementPhase.GREEN,
    GIVE_WAY: MovementPhase.GREEN_GIVE_WAY,
    YELLOW: MovementPhase.YELLOW,
    RED: MovementPhase.RED,
}
_GIVES_WAY = (MovementPhase.GREEN_GIVE_WAY, MovementPhase.YELLOW_AFTER_GIVE_WAY)


class LitJunction:
    """Junction with lights.

    Attributes:
        map: its geometry.

    Args:
        layout: the place.
        number: number of its program among the place's `signals`; its id is one more.
    """

    def __init__(self, layout: Layout, number: int) -> None:
        self._signal, self._id = layout.signals[number], number + 1
        groups = _groups_of(self._signal)
        self._group = np.array(sorted(set(groups)), dtype=np.int64)
        self._ends = np.cumsum([seconds for seconds, _ in self._signal.phases])
        columns = [groups.index(group) for group in self._group.tolist()]
        self._phase = _phase_table(self._signal, columns)
        self._changes = _change_table(self._phase, self._ends)
        self.map = _Geometry(layout, self._signal, groups).map(self._id)

    def phases(self, time_ns: int) -> SignalPhases:
        """Return the phases at a moment. Programs have fixed times, so the likely change is also the earliest."""
        now_s, cycle_s = time_ns / NS_PER_S, self._ends[-1]
        into_s = (now_s - self._signal.offset_s) % cycle_s
        row = int(np.searchsorted(self._ends, into_s + _ROUNDING_S, "right"))
        if row == len(self._ends):
            row, into_s = 0, into_s - cycle_s
        left_s = self._changes[row] - into_s
        marks = np.full(len(left_s), UNKNOWN_MARK)
        known = np.isfinite(left_s)
        marks[known] = np.rint((now_s + left_s[known]) * 10).astype(np.int64) % HOUR_DS
        marks[known & (left_s > HOUR_DS / 10)] = HOUR_DS
        return SignalPhases(self._id, time_ns, self._group, self._phase[row], marks, marks)


def lit_junctions(layout: Layout) -> tuple[LitJunction, ...]:
    """Return the junctions of a place that have lights, in the order of its `signals`."""
    return tuple(LitJunction(layout, number) for number in range(len(layout.signals)))


def _groups_of(signal: Signal) -> list[int]:
    """Return the group of each light, from 1 on: roads that always show the same are one, and crosswalks alike."""
    known: dict[tuple[bool, str], int] = {}
    columns = map("".join, zip(*(letters for _, letters in signal.phases), strict=True))
    return [known.setdefault((k < len(signal.roads), column), len(known) + 1) for k, column in enumerate(columns)]


def _phase_table(signal: Signal, columns: list[int]) -> Ints:
    """Return what the lights of some columns (G,) show in each phase of the program, (P, G)."""
    table = np.array([[_PHASES[letters[k]] for k in columns] for _, letters in signal.phases], dtype=np.int64)
    for row in [*range(len(table))] * 2:  # twice, as the last phase comes before the first
        after = (table[row] == MovementPhase.YELLOW) & np.isin(table[row - 1], _GIVES_WAY)
        table[row, after] = MovementPhase.YELLOW_AFTER_GIVE_WAY
    return table


def _change_table(phase: Ints, ends: Floats) -> Floats:
    """Return the time (P, G) s in the program at which what is shown in a phase changes; infinite: it never does."""
    twice, until = np.concatenate([phase, phase]), np.concatenate([ends, ends + ends[-1]])
    changes = np.full(twice.shape, np.inf)
    for row in range(len(twice) - 2, -1, -1):
        changes[row] = np.where(twice[row + 1] != twice[row], until[row], changes[row + 1])
    return changes[: len(phase)]


class _Geometry:
    """Lanes around the lights of one program; `groups` are those of its lights."""

    def __init__(self, layout: Layout, signal: Signal, groups: list[int]) -> None:
        self._layout, self._signal, self._groups = layout, signal, groups
        self._movements: frozenset[Road] = frozenset((*layout.movements, *signal.roads))
        self._into: dict[str, list[LaneIndex]] = {}
        self._from: dict[str, list[LaneIndex]] = {}
        for index in layout.network.lanes:
            self._into.setdefault(index[1], []).append(index)
            self._from.setdefault(index[0], []).append(index)
        stops = np.array([self._lane((*road, 0)).position(0.0, 0.0) for road in signal.roads])
        middle = stops.mean(axis=0) if len(stops) else np.zeros(2)
        self._reference = np.array([*middle, *layout.heights(middle[None])])

    def map(self, identity: int) -> IntersectionMap:
        """Return the lanes that lead to the lights, those that lead away, and crosswalks, numbered from 1 on."""
        before = {road: self._before(road) for road in self._signal.roads}
        approaches = list(dict.fromkeys(index for found in before.values() for index in found))
        ends = list(dict.fromkeys(road[1] for road in self._signal.roads if before[road]))
        number = {each: k for k, each in enumerate([*approaches, *ends], start=1)}
        connections: dict[LaneIndex, list[tuple[int, int | None]]] = {each: [] for each in approaches}
        for road, group in zip(self._signal.roads, self._groups, strict=False):
            for index in before[road]:
                connections[index].append((number[road[1]], group))
        lanes = [
            MapLane(number[each], "vehicle", self._line(each, back=True), True, False, tuple(connections[each]))
            for each in approaches
        ]
        lanes += [MapLane(number[end], "vehicle", self._exit(end), False, True) for end in ends]
        lanes += self._crosswalks(len(lanes) + 1)
        width_m = float(np.median([self._lane(each).width for each in approaches])) if approaches else None
        return IntersectionMap(identity, self._reference, tuple(lanes), width_m)

    def _before(self, road: Road) -> list[LaneIndex]:
        """Return the lanes that end where a movement starts."""
        return [each for each in self._into.get(road[0], ()) if each[:2] not in self._movements]

    def _crosswalks(self, first: int) -> Iterator[MapLane]:
        for number, nodes in enumerate(self._signal.crosswalks, start=first):
            assert self._layout.footways is not None, "crosswalks are among its ways"
            points = self._layout.footways.nodes[list(nodes)] - self._reference[:2]
            group = self._groups[len(self._signal.roads) + number - first]
            yield MapLane(number, "crosswalk", points, True, True, ((number, group),))

    def _lane(self, index: LaneIndex) -> Lane:
        return self._layout.network.get_lane(index)

    def _exit(self, node: str) -> Floats:
        """Return the points of the lane behind a movement's end, or where it ends with the place, its last metre."""
        onward = self._from.get(node, ())
        for _ in self._movements:  # one may have several pieces, and pieces may lead around without end
            if len(onward) != 1 or onward[0][:2] not in self._movements:
                break
            onward = self._from.get(onward[0][1], ())
        if onward:
            return self._line(onward[0], back=False)
        lane = self._lane(next(each for each in self._into[node] if each[:2] in self._movements))
        along = np.array([max(lane.length - 1.0, 0.0), lane.length])
        last: Floats = lane.positions(along, 0.0) - self._reference[:2]
        return last

    def _line(self, index: LaneIndex, *, back: bool) -> Floats:
        """Return points along a lane and the only ones before it, or behind it, from the junction on."""
        left_m, parts = APPROACH_M if back else EXIT_M, list[Floats]()
        while left_m > 0:
            lane = self._lane(index)
            low, high = (max(lane.length - left_m, 0.0), lane.length) if back else (0.0, min(left_m, lane.length))
            points = lane.positions(np.unique(np.clip(lane.stations(_STEP_M), low, high)), 0.0)
            parts.append(points[::-1] if back else points)
            left_m -= lane.length
            more = self._into.get(index[0], ()) if back else self._from.get(index[1], ())
            if len(more) != 1 or more[0][:2] in self._movements:
                break
            index = more[0]
        return _thinned(np.concatenate(parts) - self._reference[:2])


def _thinned(points: Floats) -> Floats:
    """Return the fewest of points (K, 2) m whose line is near them all, and no more than a message holds."""
    accuracy_m = _ACCURACY_M
    while (kept := keep_corners(points, accuracy_m)).sum() > _MOST_POINTS:
        accuracy_m *= 2
    return np.asarray(points[kept])
