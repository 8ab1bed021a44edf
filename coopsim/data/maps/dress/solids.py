"""What a map says stands beside its roads: buildings, walls, trees and poles."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from coopsim.data.maps.dress.field import Field
from coopsim.data.maps.dress.surfaces import area_m2, convex_parts, off_road
from coopsim.data.maps.street_map import StreetSolid
from coopsim.geometry import exact
from coopsim.geometry.outlines import keep_corners
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.places.description import MapBuilding, MapFurniture, MapTree, MapWall, line_of, point_of

_OFF_M = 0.4  # from the edge of a road
_STOREY_M, _STOREYS = 3.1, (2, 6)
_HUT_M2, _HUT_M, _WALL_M, _TREE_M, _POLE_M = 30.0, 2.8, 1.2, 7.0, 8.0
_STRAIGHT_M = 0.1


def buildings(solid: StreetSolid, ground: Field, seed: int) -> list[MapBuilding]:
    """Return the convex parts of a building, or of a wall with an outline, as far as they stand on no road.

    Where the map has no height, that of a wall is 1.2 m, and of a building two to five storeys by the seed.
    """
    outline = solid.line[:, :2]
    rng = stream(seed, "building of a map", solid.id)
    if solid.height_m is not None:
        height_m = float(np.clip(solid.height_m, 0.2, 500.0))
    elif solid.kind == "wall":
        height_m = _WALL_M
    else:
        hut = abs(area_m2(outline)) < _HUT_M2
        height_m = _HUT_M if hut else float(_STOREY_M * rng.integers(*_STOREYS) + 0.5)
    kept_off = replace(ground, distance_m=ground.distance_m - _OFF_M)
    glass = solid.kind == "building" and height_m > _STOREY_M
    parts = off_road(convex_parts(outline), kept_off)
    return [MapBuilding(line_of(part), height_m, windows=glass) for part in parts]


def walls(solid: StreetSolid, ground: Field) -> list[MapWall]:
    """Return the pieces of a wall along a line that stand on no road."""
    thick_m = float(np.clip(solid.thickness_m or 0.0, 0.05, 2.0))
    height_m = float(np.clip(_WALL_M if solid.height_m is None else solid.height_m, 0.2, 20.0))
    line = solid.line[keep_corners(np.ascontiguousarray(solid.line[:, :2]), _STRAIGHT_M), :2]
    found = []
    for start, end in pairwise(line):
        length_m = float(exact.norm(end - start))
        points = start + np.linspace(0.0, 1.0, int(length_m) + 2)[:, None] * (end - start)
        if length_m > _STRAIGHT_M and ground.at(points).min() > thick_m / 2 + _OFF_M:
            found.append(MapWall((point_of(start), point_of(end)), height_m, thick_m))
    return found


def trees(solid: StreetSolid, ground: Field) -> list[MapTree]:
    """Return a tree in the middle of its outline, if that is on no road."""
    line = solid.line[:, :2]
    middle = line.mean(axis=0)
    if ground.at(middle[None])[0] < _OFF_M:
        return []
    height_m = float(np.clip(_TREE_M if solid.height_m is None else solid.height_m, 2.0, 60.0))
    crown_m = float(np.clip(2 * exact.norm(line - middle).mean(), 0.5, 30.0))
    return [MapTree(point_of(middle), height_m, crown_m)]


def poles(solid: StreetSolid, ground: Field) -> list[MapFurniture]:
    """Return a pole in the middle of its outline, if that is on no road; a short one is a bollard."""
    middle: Floats = solid.line[:, :2].mean(axis=0)
    if ground.at(middle[None])[0] < _OFF_M:
        return []
    height_m = _POLE_M if solid.height_m is None else solid.height_m
    kind, least, most = ("pole", 4.0, 14.0) if height_m >= 4.0 else ("bollard", 0.4, 1.5)
    return [MapFurniture(kind, point_of(middle), height_m=float(np.clip(height_m, least, most)))]
