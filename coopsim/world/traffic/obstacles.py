"""Things beside the road that a steered car runs into, and kerbs that it mounts.

Buildings, walls, stems of trees, poles and furniture stop a car; leaves let it through.

A kerb takes speed from a car, wheel by wheel. The rim of a rigid wheel of radius R strikes the edge of a step of height
h, and its hub goes on across the line from the edge: of its speed v the share (1 - h / R)² is left, along the ground.
That loses the momentum of what the wheel carries without springs. The springs lift the quarter of the car above, which
takes m g h / 4 of its energy. Masses and radius: CommonRoad's BMW 320i (Althoff, Koschi and Manzinger, "CommonRoad:
Composable benchmarks for motion planning on roads", IEEE Intelligent Vehicles Symposium 2017; vehicle models).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.geometry.surface import Surface
from coopsim.support.kernels import njit
from coopsim.world.snapshot import StaticPart
from coopsim.world.traffic.fleet import Vehicle

WHEEL_RADIUS_M = 0.344
"""Radius of the wheels."""

UNSPRUNG = 0.1165
"""Share of the mass that the springs do not carry: 127.4 of 1093.3 kg."""

TRACK = 0.86
"""Distance between the wheels of an axle over the width of the body: 1.39 of 1.61 m."""

LOW_M, HIGH_M = 0.2, 1.0
"""Heights between which a body stops a car: what is lower goes under it, what hangs higher goes over its bonnet."""

BUILDING, OBJECT = "building", "object"
"""Kinds of what stops a car, in MetaDrive's words."""

_GRAVITY_M_S2 = 9.81
_POINT_M = 1e-3  # edges that are shorter from above are upright

Heights = Callable[[Floats], Floats]


class Obstacles:
    """Sides of what cars do not pass, seen from above.

    Args:
        outlines: buildings and walls (K, 2) m.
        parts: trees, poles and furniture.
        heights: heights (N,) m of the ground at points (N, 2) m.
    """

    def __init__(self, outlines: Sequence[Floats], parts: Sequence[StaticPart], heights: Heights) -> None:
        starts = [np.zeros((0, 2)), *(np.asarray(outline) for outline in outlines)]
        ends = [np.zeros((0, 2)), *(np.roll(outline, -1, axis=0) for outline in outlines)]
        sides = np.column_stack([np.concatenate(starts), np.concatenate(ends)])
        self._sides = {BUILDING: _in_order(sides), OBJECT: _in_order(low_edges(parts, heights))}

    def met(self, row: Any) -> str:
        """Return what a car has run into, `BUILDING` or `OBJECT`; "" for nothing."""
        return next((kind for kind, (sides, longest_m) in self._sides.items() if _meets(sides, longest_m, row)), "")


class Kerbs:
    """Edges of raised pavements.

    Args:
        pavements: outlines (K, 2) m.
        heights: heights (N,) m of the ground at points (N, 2) m.
    """

    def __init__(self, pavements: Sequence[Floats], heights: Heights) -> None:
        self._pavements, self._heights = Surface(pavements), heights
        self._before: Floats | None = None

    def slow(self, row: Any) -> None:
        """Take from a car what its wheels lose that have come onto a pavement since the last call."""
        wheels = _wheels(row)
        before, self._before = self._before, wheels
        on = self._pavements.covers(wheels)
        if before is None or not on.any():
            return
        mounts = on & ~self._pavements.covers(before)
        for rise_m in (self._heights(wheels) - self._heights(before))[mounts].tolist():
            row["speed"] = speed_over_kerb(float(row["speed"]), rise_m)


def speed_over_kerb(speed_m_s: float, rise_m: float) -> float:
    """Return the speed of a car after one wheel has mounted a kerb, m/s; 0: it is stopped there for a moment."""
    rise_m = min(max(rise_m, 0.0), WHEEL_RADIUS_M)
    struck = UNSPRUNG / 4 * (1 - (1 - rise_m / WHEEL_RADIUS_M) ** 2) * speed_m_s
    return max(math.sqrt(max(speed_m_s**2 - _GRAVITY_M_S2 * rise_m / 2, 0.0)) - struck, 0.0)


def low_edges(parts: Sequence[StaticPart], heights: Heights) -> Floats:
    """Return edges (N, 4) of closed meshes that a car would touch: x and y of both ends, m."""
    edges = [np.zeros((0, 4))]
    solid = [part for part in parts if part.closed and len(part.faces)]
    ground = heights(np.array([part.vertices[0, :2] for part in solid]).reshape(-1, 2))
    for part, ground_m in zip(solid, ground.tolist(), strict=True):
        above_m = part.vertices[:, 2] - ground_m
        if above_m.max() < LOW_M or above_m.min() > HIGH_M:
            continue
        ends = part.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        ends = ends[(ends[:, 0] < ends[:, 1]) & (above_m[ends] < HIGH_M).all(axis=1)]  # each edge has two faces
        edges.append(part.vertices[ends, :2].reshape(-1, 4))
    found = np.concatenate(edges)
    return found[np.abs(found[:, :2] - found[:, 2:]).max(axis=1, initial=0.0) > _POINT_M]


def _in_order(sides: Floats) -> tuple[Floats, float]:
    """Return sides (N, 4) by their least x, and their largest extent along x, m."""
    low, high = np.minimum(sides[:, 0], sides[:, 2]), np.maximum(sides[:, 0], sides[:, 2])
    return np.ascontiguousarray(sides[np.argsort(low, kind="stable")]), float((high - low).max(initial=0.0))


def _wheels(row: Any) -> Floats:
    """Return where the wheels (4, 2) of a car touch the ground, m."""
    along, aside = float(row["axle_m"]), TRACK * float(row["width"]) / 2
    x, y, cos, sin = float(row["x"]), float(row["y"]), math.cos(row["heading"]), math.sin(row["heading"])
    corners = ((along, aside), (along, -aside), (-along, aside), (-along, -aside))
    return np.array([[x + a * cos - b * sin, y + a * sin + b * cos] for a, b in corners])


@njit(cache=True, nogil=True)
def _meets(sides: Floats, longest_m: float, vehicle: Vehicle) -> bool:
    """Return whether a body meets one of the sides (N, 4), x and y of both ends, m, in the order of their least x."""
    cos, sin, reach = math.cos(vehicle.heading), math.sin(vehicle.heading), vehicle.length
    half = (vehicle.length / 2, vehicle.width / 2)
    first_side, behind = 0, len(sides)
    while first_side < behind:
        middle = (first_side + behind) // 2
        if min(sides[middle, 0], sides[middle, 2]) < vehicle.x - reach - longest_m:
            first_side = middle + 1
        else:
            behind = middle
    for number in range(first_side, len(sides)):
        x, y = sides[number, 0] - vehicle.x, sides[number, 1] - vehicle.y
        end_x, end_y = sides[number, 2] - vehicle.x, sides[number, 3] - vehicle.y
        if min(x, end_x) > reach:
            break
        if max(x, end_x) < -reach or min(y, end_y) > reach or max(y, end_y) < -reach:
            continue
        first, last = 0.0, 1.0  # part of the side that is within the body's length, then width, too
        for axis in range(2):
            place = x * cos + y * sin if axis == 0 else y * cos - x * sin
            there = end_x * cos + end_y * sin if axis == 0 else end_y * cos - end_x * sin
            if abs(there - place) < 1e-12:
                last = last if abs(place) <= half[axis] else -1.0
                continue
            one, other = (-half[axis] - place) / (there - place), (half[axis] - place) / (there - place)
            first, last = max(first, min(one, other)), min(last, max(one, other))
        if first <= last:
            return True
    return False
