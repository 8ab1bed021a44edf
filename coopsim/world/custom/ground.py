"""The ground of a place: kerbs, crowned roads, humps and patches of water.

| key | value |
|---|---|
| `kerb_m` | height of the pavements over the road, up to 0.3; without it they are flat; raised ones of the key |
| | `paved` must be at least 0.5 m from the middle of every lane |
| `crown` | fall of the roads to both sides, m per m, up to 0.05: between junctions, 8 m from their ends on |
| `humps` | list of speed humps: `at`, on a road; `heading_deg`, of travel; `width_m`, across; `length_m` (usually |
| | 3.7); `height_m` (usually 0.075) |
| `wet` | list of patches under water: `outline` (convex) |
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.support.checks import require_between, require_finite_number
from coopsim.world.custom.convex import read_convex
from coopsim.world.custom.groundworks import Groundworks
from coopsim.world.custom.roads import Roads
from coopsim.world.places.road_network import CircularLane, Road, RoadNetwork
from coopsim.world.relief.humps import HEIGHTS_M, LENGTHS_M, USUAL_HEIGHT_M, USUAL_LENGTH_M, Hump

GROUND_KEYS = ("kerb_m", "crown", "humps", "wet")


def read_ground(fields: Mapping[str, Entry], network: RoadNetwork) -> Groundworks:
    """Read the ground from the keys of a place.

    Raises:
        CoopsimError: of the entries' class; it says where the mistake is.
    """
    kerb_m = float(fields["kerb_m"].checked(require_between, 0, 0.3)) if "kerb_m" in fields else 0.0
    crown = float(fields["crown"].checked(require_between, 0, 0.05)) if "crown" in fields else 0.0
    humps = [_hump(item, network) for item in fields["humps"].entries()] if "humps" in fields else []
    wet = (
        [read_convex(item.fields(("outline",))["outline"]) for item in fields["wet"].entries()]
        if "wet" in fields
        else []
    )
    return Groundworks(kerb_m, crown, tuple(humps), tuple(wet))


def turning_loops(roads: Roads) -> list[Road]:
    """Return the pieces of the loops in which vehicles turn round: the only roads of several bends."""
    loops = [
        pieces
        for pieces in roads.pieces.values()
        if len(pieces) > 1 and all(isinstance(roads.lane(piece), CircularLane) for piece in pieces)
    ]
    return [piece for pieces in loops for piece in pieces]


def _hump(entry: Entry, network: RoadNetwork) -> Hump:
    fields = entry.fields(("at", "heading_deg", "width_m"), ("length_m", "height_m"))
    at = fields["at"].point()
    if not any(lane.contains(at) for lane in network.lanes.values()):
        raise fields["at"].error("a hump must be on a road")
    heading_rad = np.radians(float(fields["heading_deg"].checked(require_finite_number)))
    usual = {"width_m": 0.0, "length_m": USUAL_LENGTH_M, "height_m": USUAL_HEIGHT_M}
    limits = {"width_m": (1, 40), "length_m": LENGTHS_M, "height_m": HEIGHTS_M}
    sizes = [
        float(fields[name].checked(require_between, *limits[name])) if name in fields else usual[name] for name in usual
    ]
    return Hump(float(at[0]), float(at[1]), float(heading_rad), *sizes)
