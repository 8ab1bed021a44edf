"""The ground of a place: kerbs, crowned roads, humps, patches of water and further surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.world.custom.clearance import MiddleLines, convex
from coopsim.world.custom.groundworks import Groundworks
from coopsim.world.custom.roads import Roads
from coopsim.world.places.description import SURFACES, MapArea, MapHump
from coopsim.world.places.layout import flat_part
from coopsim.world.places.road_network import CircularLane, Road
from coopsim.world.relief.surfaces import USUAL_HEIGHT_M, USUAL_LENGTH_M, Hump
from coopsim.world.relief.terrain import STEEPEST, Terrain
from coopsim.world.snapshot import StaticPart

AROUND_M = 150.0
"""Of ground on each side of the outermost nodes."""


def build_terrain(roads: Roads, low: Floats, high: Floats) -> Terrain | None:
    """Build the ground between two corners (2,) m from the heights in a description; None: it is flat."""
    heights, entry = roads.description.heights, roads.root.part("heights")
    if not heights:
        return None
    for k, spot in enumerate(heights):
        if len(spot) != 3:
            raise entry.part(k).error(f"heights must be lists of x, y and z, got one of {len(spot)}")
    spots = np.array(heights, dtype=np.float64)
    if ((spots[:, :2] < low) | (spots[:, :2] > high)).any():
        raise entry.error(f"heights must be at most {AROUND_M:g} m from the nodes")
    terrain = Terrain(spots, low, high)
    if terrain.steepest > STEEPEST:
        raise entry.error(
            f"the ground must rise by at most {STEEPEST:g} m per m at the places of heights, got "
            f"{terrain.steepest:.2f} even where it is smooth"
        )
    return terrain


def build_ground(roads: Roads, terrain: Terrain | None) -> Groundworks:
    """Build the shape of the ground from a description and its terrain."""
    description, root = roads.description, roads.root
    humps = tuple(_hump(hump, k, roads) for k, hump in enumerate(description.humps))
    wet = tuple(convex(patch.outline, root.part("wet", k, "outline")) for k, patch in enumerate(description.wet))
    return Groundworks(float(description.kerb_m), float(description.crown), humps, wet, terrain)


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
    lanes = _kept_off(middles, np.s_[:])
    for number, outline in enumerate(outlines):
        if lanes.is_free(outline):
            continue
        segments = range(len(middles.starts))
        near = next(k for k in segments if not _kept_off(middles, np.s_[k : k + 1]).is_free(outline))
        place = [k for k, area in enumerate(roads.description.paved) if area.kind == PAVEMENT][number]
        raise roads.root.part("paved", place).error(
            f"a raised pavement must be at least {_LEAST_M:g} m from the middle of every lane, and this one is "
            f"nearer to that of the road in {middles.spot(near)}: move it, or give a crosswalk instead"
        )


def _kept_off(middles: MiddleLines, which: slice) -> TakenGround:
    """Return the ground within `_LEAST_M` of pieces of the middle lines."""
    taken, starts = TakenGround(), middles.starts[which]
    taken.take_lines(starts, middles.ends[which], np.full(len(starts), _LEAST_M))
    return taken
