"""Kerbs, and lines along them: parking strip, people's way, border of private ground.

Driving along the right edge of a street, and turning right at every junction and around in every turning loop, leads
back to the start. Each such round has a block of the town, or the country outside, on its right. Lines beside the
street are the round's kerb, moved to the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import distances_to_lines
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.towns.plan import LANE_M, LOOP_RADIUS_M, LOOP_REACH_M, Junction, Plan, Street

STRIP_M = 2.5
"""Width of a strip for parked vehicles."""

_STEP_M = 2.0  # between points along a street
_NECK_M = 20.0  # radius of the bends between a street's end and its loop
_JUNCTION_FREE_M = 9.0  # from stop lines to the first parked vehicle: one turns there, and people cross
_LOOP_FREE_M = 4.0
_TAPER_M = 3.0  # from the edge of the lanes to that of the strip
_TRIM_M = 0.1  # lines are kept where they are at most this much too close to another kerb
_WIDENS_M = 0.01

STREET, CORNER, LOOP = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """Part of a round: one side of a street, the corner between two arms, or a turning loop.

    Attributes:
        kind: `STREET`, `CORNER` or `LOOP`.
        number: number of the street, or of the corner's junction.
        arm: arm at which a corner begins; else 1 where the round goes from the street's beginning to its end, or -1.
        kerb: (K, 2) m, edge of the lanes.
        along_m: (K,) place along a street, else zeros.
        strip_m: (K,) width of the parking strip.
    """

    kind: int
    number: int
    arm: int
    kerb: Floats
    along_m: Floats
    strip_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """Closed line along the right edge of streets.

    Attributes:
        sides: parts in order; the first point of each is the last one of the part before.
        side: (N,) index of the part that each point belongs to.
        kerb: (N, 2) m, edge of the lanes.
        right: (N, 2) unit vectors away from the street.
        strip_m: (N,) width of the parking strip.
        along_m: (N,) place along the street, where the part is one.
    """

    sides: tuple[Side, ...]
    side: Ints
    kerb: Floats
    right: Floats
    strip_m: Floats
    along_m: Floats

    def parts(self, *kinds: int) -> list[tuple[Side, Ints]]:
        """Return the sides of some kinds that have points, each with the indices (K,) of these."""
        found = [(side, np.flatnonzero(self.side == k)) for k, side in enumerate(self.sides) if side.kind in kinds]
        return [(side, index) for side, index in found if len(index)]

    def offset(self, away_m: float) -> Floats:
        """Return places (N, 2) m, `away_m` to the right of the parking strip."""
        places: Floats = self.kerb + (self.strip_m + away_m)[:, None] * self.right
        return places

    def clear_offset(self, away_m: float, lines: tuple[Floats, Floats, Floats]) -> Floats:
        """Return places (N, 2) m like `offset`, but at sharp corners those where the lines of both streets meet.

        `lines` are starts (M, 2), ends (M, 2) m and widths (M,) of `kerb_lines_of`.
        """
        places = self.offset(away_m)
        clear = np.flatnonzero(distances_to_lines(places, *lines) >= away_m - _TRIM_M)
        if not len(clear):
            return places
        count = len(places)
        index = np.arange(count)
        return np.column_stack([np.interp(index, clear, places[clear, axis], period=count) for axis in (0, 1)])


def trace_rounds(plan: Plan) -> tuple[Round, ...]:
    """Return all rounds of a plan."""
    left = {(street.number, way) for street in plan.streets for way in (1, -1)}
    rounds = []
    while left:
        first = place = min(left)
        sides: list[Side] = []
        while place in left:
            left.remove(place)
            street = plan.streets[place[0]]
            sides.append(_street_side(street, place[1]))
            end = street.end if place[1] > 0 else street.begin
            if end.junction is None:
                sides.append(_loop_side(street, place[1]))
                place = (street.number, -place[1])
            else:
                junction = plan.junctions[end.junction]
                kerb = corner_kerb(junction, end.arm)
                zeros = np.zeros(len(kerb))
                sides.append(Side(CORNER, junction.number, end.arm, kerb, zeros, zeros))
                onward = junction.arms[(end.arm + 1) % len(junction.arms)]
                place = (onward.street, 1 if onward.outwards else -1)
        assert place == first
        rounds.append(_round_of(sides))
    return tuple(rounds)


def kerb_lines_of(rounds: tuple[Round, ...]) -> tuple[Floats, Floats, Floats]:
    """Return starts (M, 2), ends (M, 2) m of all kerbs, and the widths (M,) of the strips beside them."""
    starts = np.concatenate([each.kerb for each in rounds])
    ends = np.concatenate([np.roll(each.kerb, -1, axis=0) for each in rounds])
    widths = np.concatenate([np.minimum(each.strip_m, np.roll(each.strip_m, -1)) for each in rounds])
    return starts, ends, widths


def _street_side(street: Street, way: int) -> Side:
    first, last = street.span_m
    even = np.linspace(first, last, max(2, int(np.ceil((last - first) / _STEP_M)) + 1))
    along = np.unique([*even, *(station.along_m for station in street.stations)])
    half_m = street.half_m(along)
    parks = street.parking_right if way > 0 else street.parking_left
    strip_m = _strip_width(street, along, half_m) if parks else np.zeros(len(along))
    order = slice(None) if way > 0 else slice(None, None, -1)
    kerb = street.position(along, -way * half_m)
    return Side(STREET, street.number, way, kerb[order], along[order], strip_m[order])


def _strip_width(street: Street, along: Floats, half_m: Floats) -> Floats:
    """Return the widths (K,) of a strip, with tapers at its ends; 0 where lanes split or join."""
    first, last = street.span_m
    begin = first + (_LOOP_FREE_M if street.begin.junction is None else _JUNCTION_FREE_M)
    end = last - (_LOOP_FREE_M if street.end.junction is None else _JUNCTION_FREE_M)
    room_m = np.minimum(along - begin, end - along)
    shifts = np.flatnonzero(np.abs(np.diff(half_m)) > _WIDENS_M)
    for k in shifts:
        room_m = np.minimum(room_m, np.maximum(along[k] - along, along - along[k + 1]))
    return np.asarray(STRIP_M * np.clip(room_m / _TAPER_M, 0.0, 1.0))


def _loop_side(street: Street, way: int) -> Side:
    """Return the outer edge of the loop at a street's end: a neck, the circle, and a neck."""
    end_m = street.span_m[1 if way > 0 else 0]
    heading = float(street.heading(end_m)[0]) + (0.0 if way > 0 else np.pi)
    ahead = np.array([exact.cos(heading), exact.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    origin = street.position(end_m)[0]
    half_m, outer_m, neck_m = LANE_M, LOOP_RADIUS_M + LANE_M / 2, _NECK_M - LANE_M / 2
    middle, aside = np.array([LOOP_REACH_M, 0.0]), np.array([0.0, -half_m - neck_m])
    touch = middle + (aside - middle) * outer_m / (outer_m + neck_m)
    down = arc_points(aside, np.array([0.0, -half_m]), touch)
    right = arc_points(middle, touch, middle + np.array([outer_m, 0.0]))
    half = np.concatenate([down, right[1:]])
    along, across = np.hsplit(np.concatenate([half, half[-2::-1] * [1.0, -1.0]]), 2)
    kerb = origin + (along * ahead + across * left)
    zeros = np.zeros(len(kerb))
    return Side(LOOP, street.number, way, kerb, zeros, zeros)


def _round_of(sides: list[Side]) -> Round:
    """Join parts; each gives all its points but the last."""
    kerb = np.concatenate([side.kerb[:-1] for side in sides])
    ahead = np.roll(kerb, -1, axis=0) - kerb
    ahead /= np.maximum(exact.norm(ahead, axis=1), 1e-9)[:, None]
    mean = ahead + np.roll(ahead, 1, axis=0)
    # At a kink the line beside it is as far from both edges.
    mean *= (2 / np.maximum(np.square(mean).sum(axis=1), 1.0))[:, None]
    return Round(
        tuple(sides),
        np.repeat(np.arange(len(sides)), [len(side.kerb) - 1 for side in sides]),
        kerb,
        np.column_stack([mean[:, 1], -mean[:, 0]]),
        np.concatenate([side.strip_m[:-1] for side in sides]),
        np.concatenate([side.along_m[:-1] for side in sides]),
    )


_CHORD_M = 2.0  # of an arc
_STRAIGHT_M = 400.0  # kerbs of a larger radius are straight


def corner_kerb(junction: Junction, arm: int) -> Floats:
    """Return the kerb (K, 2) m from an arm to the next one, counter-clockwise: the edge of the junction's own surface.

    It begins at the outer edge of the arm's stop line and ends where the next arm's outermost lane outwards begins.
    Vehicles drive on its left.
    """
    after = (arm + 1) % len(junction.arms)
    ends = (
        junction.place(arm, junction.stop_m, junction.half_m),
        junction.place(after, junction.stop_m, -junction.half_m),
    )
    if junction.kind == "roundabout":
        return _ring_kerb(junction, arm, after)
    # The distance to the middle of the bend; < 0: on the other side.
    reach_m = junction.stop_m * exact.tan(junction.gap_rad(arm) / 2)
    if abs(reach_m) > _STRAIGHT_M:
        return np.array(ends)
    return arc_points(junction.place(arm, junction.stop_m, reach_m), *ends)


def arc_points(centre: Floats, start: Floats, end: Floats) -> Floats:
    """Return points (K, 2) m from `start` (2,) to `end` (2,) on the shorter arc around `centre` (2,)."""
    first, last = (exact.arctan2(*(point - centre)[::-1]) for point in (start, end))
    swept = (last - first + np.pi) % (2 * np.pi) - np.pi
    radius = float(exact.norm(start - centre))
    angle = first + np.linspace(0.0, swept, max(2, int(np.ceil(radius * abs(swept) / _CHORD_M)) + 1))
    points: Floats = centre + radius * np.column_stack([exact.cos(angle), exact.sin(angle)])
    points[0], points[-1] = start, end
    return points


def touch_rad(junction: Junction) -> float:
    """Return the angle at a roundabout's centre between an arm and the place where its bends touch the ring."""
    return float(exact.arcsin((junction.entry_m + junction.inner_m) / (junction.ring_m + junction.entry_m)))


def _ring_kerb(junction: Junction, arm: int, after: int) -> Floats:
    outer_m, aside_m = junction.ring_m + LANE_M / 2, junction.entry_m + junction.inner_m
    first, last = (junction.arms[k].heading_rad for k in (arm, after))
    touch = first + touch_rad(junction), last - touch_rad(junction)
    spots = [junction.centre + outer_m * np.array([exact.cos(angle), exact.sin(angle)]) for angle in touch]
    stop_m, half_m = junction.stop_m, junction.half_m
    entry = arc_points(junction.place(arm, stop_m, aside_m), junction.place(arm, stop_m, half_m), spots[0])
    end = junction.place(after, stop_m, -half_m)
    leaving = arc_points(junction.place(after, stop_m, -aside_m), spots[1], end)
    return np.concatenate([entry, arc_points(junction.centre, *spots)[1:], leaving[1:]])
