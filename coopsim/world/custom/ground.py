"""The ground of a place: kerbs, crowned roads, humps, patches of water and further surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.custom.clearance import MiddleLines, convex
from coopsim.world.custom.groundworks import Groundworks
from coopsim.world.custom.roads import Roads
from coopsim.world.places.description import SURFACES, MapArea, MapHump
from coopsim.world.places.layout import flat_part
from coopsim.world.places.road_network import CircularLane, Road
from coopsim.world.relief.surfaces import USUAL_HEIGHT_M, USUAL_LENGTH_M, Hump
from coopsim.world.snapshot import StaticPart


def build_ground(roads: Roads) -> Groundworks:
    """Build the shape of the ground from a description."""
    description, root = roads.description, roads.root
    humps = tuple(_hump(hump, k, roads) for k, hump in enumerate(description.humps))
    wet = tuple(convex(patch.outline, root.part("wet", k, "outline")) for k, patch in enumerate(description.wet))
    return Groundworks(float(description.kerb_m), float(description.crown), humps, wet)


def turning_loops(roads: Roads) -> list[Road]:
    """Return the pieces of the loops in which vehicles turn round: the only roads of several bends."""
    loops = [
        pieces
        for pieces in roads.pieces.values()
        if len(pieces) > 1 and all(isinstance(roads.lane(piece), CircularLane) for piece in pieces)
    ]
    return [piece for pieces in loops for piece in pieces]


def _hump(hump: MapHump, number: int, roads: Roads) -> Hump:
    x, y = map(float, hump.at)
    at = np.array([x, y])
    if not any(lane.contains(at) for lane in roads.network.lanes.values()):
        raise roads.root.part("humps", number, "at").error("a hump must be on a road")
    length_m = USUAL_LENGTH_M if hump.length_m is None else hump.length_m
    height_m = USUAL_HEIGHT_M if hump.height_m is None else hump.height_m
    return Hump(x, y, float(np.radians(hump.heading_deg)), float(hump.width_m), float(length_m), float(height_m))


@dataclass(frozen=True, slots=True)
class Paving:
    """A kind of surface.

    Attributes:
        z_m: height.
        color: RGB.
        reflectivity: at 905 nm, in [0, 1].
    """

    z_m: float
    color: tuple[int, int, int]
    reflectivity: float


PAVINGS: Mapping[str, Paving] = {
    "grass": Paving(-0.03, (86, 116, 66), 0.45),
    "yard": Paving(-0.02, (134, 126, 114), 0.3),
    "parking": Paving(-0.005, (88, 88, 90), 0.22),
}
"""Surfaces with a mesh of their own, from the lowest to the highest. Grass is bright to infrared light; the rest are
slabs and old asphalt."""

PAVEMENT = "pavement"
"""The kind that is raised with `kerb_m`."""


def build_paved(areas: Sequence[MapArea], root: Entry) -> dict[str, list[Floats]]:
    """Return convex outlines (K, 2) m, counter-clockwise, by kind."""
    found: dict[str, list[Floats]] = {kind: [] for kind in SURFACES}
    for k, area in enumerate(areas):
        found[area.kind].append(convex(area.outline, root.part("paved", k, "outline")))
    return found


def paved_parts(paved: Mapping[str, list[Floats]]) -> list[StaticPart]:
    """Build the surfaces that are neither road nor pavement, from outlines by kind."""
    return [
        flat_part(name, paved[name], paving.z_m, paving.color, paving.reflectivity)
        for name, paving in PAVINGS.items()
        if paved[name]
    ]


_LEAST_M = 0.5  # from the middle of a lane: pavements reach under the edges of lanes, in kinks by up to a metre


def require_off_lanes(outlines: Sequence[Floats], roads: Roads, middles: MiddleLines) -> None:
    """Raise an error if a raised pavement is in the way of vehicles: wheels and bumpers would stick in it.

    `outlines` are convex, (K, 2) m, counter-clockwise, in the order of the pavements among `paved`.
    """
    ends = np.cumsum([len(outline) for outline in outlines])
    number, segment = _first_across(np.concatenate(outlines), ends, middles.starts, middles.ends, _LEAST_M)
    if number >= 0:
        place = [k for k, area in enumerate(roads.description.paved) if area.kind == PAVEMENT][number]
        raise roads.root.part("paved", place).error(
            f"a raised pavement must be at least {_LEAST_M:g} m from the middle of every lane, and this one is "
            f"nearer to that of the road in {middles.spot(segment)}: move it, or give a crosswalk instead"
        )


@njit(cache=True, nogil=True)
def _first_across(corners: Floats, ends: Ints, start: Floats, end: Floats, least_m: float) -> tuple[int, int]:
    """Return the first outline that is nearer than `least_m` to a segment, and this segment; -1, -1 if there is none.

    `corners` (C, 2) m are those of all outlines, convex and counter-clockwise, and `ends` (P,) the first corner behind
    each. Segments lead from `start` (S, 2) m to `end` (S, 2) m.
    """
    first = 0
    for number in range(len(ends)):
        outline = corners[first : ends[number]]
        first = ends[number]
        low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
        for x, y in outline:
            low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
        for k in range(len(start)):
            ax, ay, bx, by = start[k, 0], start[k, 1], end[k, 0], end[k, 1]
            if max(ax, bx) + least_m < low_x or min(ax, bx) - least_m > high_x:
                continue
            if max(ay, by) + least_m < low_y or min(ay, by) - least_m > high_y:
                continue
            if _is_near(outline, ax, ay, bx, by, least_m):
                return number, k
    return -1, -1


@njit(cache=True, nogil=True)
def _is_near(outline: Floats, ax: float, ay: float, bx: float, by: float, reach_m: float) -> bool:
    """Return whether a segment from a to b comes nearer than `reach_m` to a convex outline (K, 2) m, or into it."""
    enter, leave = 0.0, 1.0  # shares of the segment that are inside all sides so far
    for k in range(len(outline)):
        px, py = outline[k]
        qx, qy = outline[(k + 1) % len(outline)]
        if (
            min(
                _distance_m(px, py, ax, ay, bx, by),
                _distance_m(ax, ay, px, py, qx, qy),
                _distance_m(bx, by, px, py, qx, qy),
            )
            < reach_m
        ):
            return True
        at_a = (qx - px) * (ay - py) - (qy - py) * (ax - px)  # > 0: on the inner side of this side
        at_b = (qx - px) * (by - py) - (qy - py) * (bx - px)
        if at_a < 0 and at_b < 0:
            leave = -1.0
        elif at_a < 0:
            enter = max(enter, at_a / (at_a - at_b))
        elif at_b < 0:
            leave = min(leave, at_a / (at_a - at_b))
    return enter < leave


@njit(cache=True, nogil=True)
def _distance_m(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance of a point from the segment from a to b."""
    along_x, along_y = bx - ax, by - ay
    length_m2 = max(along_x * along_x + along_y * along_y, 1e-12)
    share = min(max(((x - ax) * along_x + (y - ay) * along_y) / length_m2, 0.0), 1.0)
    distance_m: float = exact.hypot(x - ax - share * along_x, y - ay - share * along_y)
    return distance_m
