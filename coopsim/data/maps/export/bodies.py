"""Bodies beside the lanes of a place: crosswalks, bays, buildings, walls, trees and furniture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.furniture.kinds import KINDS, Kind
from coopsim.world.places.description import MapFurniture, PlaceDescription

_CROSSWALK_M = 3.0
_TO_KERB_M = 2.6  # from where people walk
_BAY_M = (6.0, 2.4)
_WALL_M = 0.25
_TYPES = {"tree": "tree", "bush": "vegetation", "hedge": "vegetation", "lamp": "streetLamp", "pole": "pole",
          "railing": "railing"}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """An object on an outline, or along a line (K, 2) m; with one point, it is round.

    `more` are further attributes.
    """

    kind: str
    line: Floats
    height_m: float
    closed: bool = True
    more: Mapping[str, object] = field(default_factory=dict)


def bodies_of(description: PlaceDescription) -> Iterator[Body]:
    """Yield the objects of a town."""
    walks = description.walks
    for places in () if walks is None else [[walks.nodes[name] for name in names] for names in walks.crosswalks]:
        ends = np.array(places)
        along = ends[1] - ends[0]
        size_m = float(exact.norm(along)) - 2 * _TO_KERB_M, _CROSSWALK_M
        yield Body("crosswalk", _rectangle(ends.mean(axis=0), along, *size_m), 0.0)
    for bay in description.parked:
        yield Body("parkingSpace", _rectangle(bay.at, _ahead(bay.heading_deg), *_BAY_M), 0.0)
    for building in description.buildings:
        yield Body("building", np.array(building.outline), building.height_m)
    for wall in description.walls:
        thickness_m = _WALL_M if wall.thickness_m is None else wall.thickness_m
        yield Body("barrier", np.array(wall.along), wall.height_m, closed=False, more={"width": thickness_m})
    for piece in description.furniture or ():
        kind = KINDS[piece.kind]
        if "height_m" in kind.sizes:
            yield _furniture(piece, kind)


def _furniture(piece: MapFurniture, kind: Kind) -> Body:
    """Return a piece of furniture: along a line, a tree with its crown, or a rectangle on the ground."""
    name, usual = _TYPES.get(piece.kind, "obstacle"), kind.sizes
    height_m = usual["height_m"].usual if piece.height_m is None else piece.height_m
    if kind.along:
        thickness_m = kind.ground_m[1] if piece.thickness_m is None else piece.thickness_m
        line_type = "barrier" if name == "obstacle" else name
        return Body(line_type, np.array(piece.along), height_m, closed=False, more={"width": thickness_m})
    if name == "tree":
        crown_m = usual["crown_m"].usual if piece.crown_m is None else piece.crown_m
        return Body(name, np.array([piece.at]), height_m, more={"radius": crown_m / 2})
    assert piece.at is not None, "it stands at a point"
    return Body(name, _rectangle(piece.at, _ahead(piece.heading_deg or 0.0), *kind.ground_m), height_m)


def _ahead(heading_deg: float) -> Floats:
    heading = np.radians(heading_deg)
    return np.array([exact.cos(heading), exact.sin(heading)])


def _rectangle(middle: ArrayLike, ahead: Floats, length_m: float, width_m: float) -> Floats:
    """Return corners (4, 2) m, counter-clockwise."""
    along = ahead / float(exact.norm(ahead)) * length_m / 2
    aside = np.array([-along[1], along[0]]) * width_m / length_m
    corners = np.array([-along - aside, along - aside, along + aside, aside - along])
    return np.asarray(np.asarray(middle) + corners)
