"""Plan of a drawn town: streets by their centre lines, and the junctions where they meet.

A plan is not turned yet: `turn_rad` is applied to all that is drawn on it, at the very end. One drives on the right.
Along a street, `along_m` is counted from its beginning, and `aside_m` from its centre line, positive to the left of the
direction from beginning to end. So vehicles that travel from beginning to end are at negative `aside_m`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

LANE_M = 4.25
"""Width of every lane: ways over a junction side by side do not conflict, bent ones neither (`CLEARANCE_M`)."""

INNER_M = 2.05
"""Distance from a street's centre line to the middle of the lanes next to it. Opposite ways over a junction are closer
than `CLEARANCE_M`: where they bend, they conflict, because two trucks would touch."""

ROUNDABOUT_MEDIAN_M = 2.0
"""Width between the two directions of a roundabout's arm at its stop line: leaving buses swing out."""

LOOP_RADIUS_M = 10.0
"""Radius of a turning loop's middle line; the lane is `LANE_M` wide."""

LOOP_REACH_M = float(np.sqrt(np.square(30.0) - np.square(20.0 + INNER_M)))
"""Distance from the end of a street to the middle of its turning loop, on the line that goes straight on there."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Straight piece of a centre line, or an arc, from a start (2,) m on.

    `curvature_1_m` is one over the radius; 0: straight, > 0: to the left.
    """

    start: Floats
    heading_rad: float
    length_m: float
    curvature_1_m: float = 0.0

    def heading(self, along_m: Floats) -> Floats:
        """Return directions (N,) rad at distances (N,) from the start, which may be beyond either end."""
        return self.heading_rad + self.curvature_1_m * along_m

    def position(self, along_m: Floats, aside_m: Floats) -> Floats:
        """Return places (N, 2) m at distances (N,) from the start and (N,) to the left of the line."""
        first, heading = self.heading_rad, self.heading(along_m)
        left = np.column_stack([-exact.sin(heading), exact.cos(heading)])
        if self.curvature_1_m == 0.0:
            middle = self.start + along_m[:, None] * np.array([exact.cos(first), exact.sin(first)])
        else:
            sweep = np.column_stack([exact.sin(heading) - exact.sin(first), exact.cos(first) - exact.cos(heading)])
            middle = self.start + sweep / self.curvature_1_m
        places: Floats = middle + aside_m[:, None] * left
        return places


@dataclass(frozen=True, slots=True)
class StreetEnd:
    """End of a street, at an arm of a junction or (junction None, arm -1) in a turning loop.

    `stop_m` is the distance from this end of the line, which is the junction's centre, to the stop line and to the
    first place of the way out; 0 at a loop.
    """

    junction: int | None
    arm: int = -1
    stop_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Station:
    """Cross-section of a street at `along_m`, the same on both sides of the centre line.

    There are `lanes` in each direction. `inner_m` is the distance from the centre line to the middle of the lane next
    to it (`INNER_M` without a median).
    """

    along_m: float
    lanes: int
    inner_m: float = INNER_M

    @property
    def half_m(self) -> float:
        """Distance from the centre line to the outer edge of the lanes."""
        return self.inner_m + (self.lanes - 0.5) * LANE_M


@dataclass(frozen=True, slots=True, eq=False)
class Street:
    """Street: lanes in both directions along a line.

    Attributes:
        number: index in `Plan.streets`.
        line: centre line between the centres of two junctions (or loops), straight wherever the cross-section changes.
        begin: end where `along_m` is 0.
        end: other end.
        stations: cross-sections where they change, ascending, the first at the first place with lanes, the last at the
            last one. Between two with as many lanes, lanes are parallel or shift evenly; between others, the outermost
            lane of the wider one splits off or joins.
        speed_m_s: limit.
        parking_left: strip for parked vehicles outside the lanes at positive `aside_m`, where space allows.
        parking_right: strip at negative `aside_m`.
    """

    number: int
    line: tuple[Stretch, ...]
    begin: StreetEnd
    end: StreetEnd
    stations: tuple[Station, ...]
    speed_m_s: float
    parking_left: bool = False
    parking_right: bool = False

    @property
    def length_m(self) -> float:
        """Length of the whole line."""
        return sum(stretch.length_m for stretch in self.line)

    @property
    def span_m(self) -> tuple[float, float]:
        """First and last `along_m` where the street has lanes: outside is the junction's own surface."""
        return self.stations[0].along_m, self.stations[-1].along_m

    def half_m(self, along_m: ArrayLike) -> Floats:
        """Return the distances (N,) from the centre line to the outer edge of the lanes, on either side."""
        places = [station.along_m for station in self.stations]
        return np.asarray(np.interp(np.asarray(along_m), places, [station.half_m for station in self.stations]))

    def heading(self, along_m: ArrayLike) -> Floats:
        """Return directions (N,) rad of the centre line."""
        along, which, first = self._located(along_m)
        found = np.empty_like(along)
        for k in set(which.tolist()):
            found[which == k] = self.line[k].heading(along[which == k] - first[k])
        return found

    def position(self, along_m: ArrayLike, aside_m: ArrayLike = 0.0) -> Floats:
        """Return places (N, 2) m; beyond the ends the line goes on straight, or bends on."""
        along, which, first = self._located(along_m)
        aside = np.broadcast_to(np.asarray(aside_m, dtype=np.float64), along.shape)
        found = np.empty((len(along), 2))
        for k in set(which.tolist()):
            own = which == k
            found[own] = self.line[k].position(along[own] - first[k], aside[own])
        return found

    def _located(self, along_m: ArrayLike) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.int64]], Floats]:
        """Return distances (N,), the stretch (N,) that each is on, and where all stretches begin."""
        along = np.atleast_1d(np.asarray(along_m, dtype=np.float64))
        first = np.cumsum([0.0, *(stretch.length_m for stretch in self.line[:-1])])
        return along, np.maximum(np.searchsorted(first, along, side="right") - 1, 0), first


@dataclass(frozen=True, slots=True)
class Arm:
    """Street where it leaves a junction, with its heading from the centre outwards.

    `outwards`: the street begins here, so its `along_m` grows outwards.
    """

    heading_rad: float
    street: int
    outwards: bool


@dataclass(frozen=True, slots=True, eq=False)
class Junction:
    """Junction where three to five streets meet.

    Attributes:
        number: index in `Plan.junctions`.
        centre: (2,) m, where the lines of all arms meet.
        kind: "priority" (vehicles go straight on between the arms in `main` first), "equal" (first come, first served)
            or "roundabout" (vehicles on the ring go first).
        arms: counter-clockwise, straight from the centre to beyond their stop lines.
        stop_m: distance from the centre to all stop lines, and to the beginnings of ways out.
        lanes: number of lanes in each direction, the same for all arms.
        main: numbers of the two arms with priority.
        ring_m: radius of the middle line of a roundabout's ring, which has one lane.
        entry_m: radius of the middle lines of the bends between a roundabout's arms and its ring.
    """

    number: int
    centre: Floats
    kind: str
    arms: tuple[Arm, ...]
    stop_m: float
    lanes: int = 1
    main: tuple[int, int] | None = None
    ring_m: float = 0.0
    entry_m: float = 0.0

    @property
    def inner_m(self) -> float:
        """Distance from the arms' centre lines to the middle of the lane next to them, at the stop line."""
        return INNER_M + (ROUNDABOUT_MEDIAN_M / 2 if self.kind == "roundabout" else 0.0)

    @property
    def half_m(self) -> float:
        """Distance from the arms' centre lines to the outer edge of their lanes, at the stop line."""
        return self.inner_m + (self.lanes - 0.5) * LANE_M

    def place(self, arm: int, along_m: float, aside_m: float) -> Floats:
        """Return a place (2,) m at a distance from the centre along an arm, and to the left of its way outwards."""
        heading = self.arms[arm].heading_rad
        cos, sin = exact.cos(heading), exact.sin(heading)
        offset = np.array([cos * along_m - sin * aside_m, sin * along_m + cos * aside_m])
        return np.asarray(self.centre + offset)

    def gap_rad(self, arm: int) -> float:
        """Return the angle from an arm to the next one, counter-clockwise, in (0, 2 pi)."""
        after = self.arms[(arm + 1) % len(self.arms)].heading_rad
        return float((after - self.arms[arm].heading_rad) % (2 * np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Streets and junctions of a town.

    Connected cars meet at the junction of number `meeting`, whose centre is near the origin. The finished town is
    turned about the origin by `turn_rad`.
    """

    streets: tuple[Street, ...]
    junctions: tuple[Junction, ...]
    meeting: int
    turn_rad: float = 0.0


_SHARPEST_M = 20.0  # least radius of a centre line: the lane inside still has room for a bus
_SHORTEST_M = 6.0  # length of an arc, and of a straight piece that is not of length 0
_WIDEST_M = 140.0  # largest radius


def rounded(points: Floats, straight_m: tuple[float, float], lanes: int) -> tuple[Stretch, ...] | None:
    """Return a line from the first to the last point, with an arc as wide as possible at every other one.

    Args:
        points: (K, 2) m.
        straight_m: lengths at both ends where the line must be straight.
        lanes: number of lanes on either side, for which the bends must be wide enough.

    Returns:
        Stretches; None if there is no space for the arcs.
    """
    legs = np.diff(points, axis=0)
    lengths = exact.hypot(legs[:, 0], legs[:, 1]).tolist()
    headings = exact.arctan2(legs[:, 1], legs[:, 0]).tolist()
    free = list(lengths)  # of each leg, without what must be straight
    free[0] -= straight_m[0]
    free[-1] -= straight_m[1]
    stretches, at, spare = list[Stretch](), points[0], 0.0
    for k, heading in enumerate(headings):
        last = k == len(headings) - 1
        share_m = free[k] if k == 0 else free[k] / 2
        if last:
            if lengths[k] - spare < _SHORTEST_M or free[k] - (spare if k else 0.0) < 0.0:
                return None
            stretches.append(Stretch(at, heading, lengths[k] - spare))
            break
        turn = math.remainder(headings[k + 1] - heading, 2 * math.pi)
        ahead_m = free[k + 1] if k + 1 == len(headings) - 1 else free[k + 1] / 2
        room_m = min(share_m, ahead_m) - _SHORTEST_M
        radius = min(room_m / exact.tan(abs(turn) / 2), _WIDEST_M) if turn else 0.0
        inside_m = LANE_M * lanes
        if radius < _SHARPEST_M + inside_m - LANE_M or (radius - inside_m) * abs(turn) < _SHORTEST_M:
            return None
        tangent_m = radius * exact.tan(abs(turn) / 2)
        straight = lengths[k] - spare - tangent_m
        stretches.append(Stretch(at, heading, straight))
        at = at + straight * np.array([exact.cos(heading), exact.sin(heading)])
        stretches.append(Stretch(at, heading, radius * abs(turn), math.copysign(1 / radius, turn)))
        at = points[k + 1] + tangent_m * np.array([exact.cos(headings[k + 1]), exact.sin(headings[k + 1])])
        spare = tangent_m
    return tuple(stretches)
