"""Buildings, walls, trees and street furniture of a description."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.custom.clearance import MiddleLines, along_outline, convex
from coopsim.world.furniture.free_ground import rectangle_at
from coopsim.world.furniture.furnish import line_pieces, size_m
from coopsim.world.furniture.kinds import KINDS, Kind
from coopsim.world.places.description import MapBuilding, MapFurniture, MapTree, MapWall
from coopsim.world.places.scenery import COLORS, PAINTS
from coopsim.world.places.shapes import ball, cylinder
from coopsim.world.relief.kerbs import divided
from coopsim.world.relief.terrain import CELL_M, Terrain
from coopsim.world.snapshot import StaticPart

_REFLECTIVITY = 0.4
_GLASS, _GLASS_REFLECTIVITY = (66, 80, 94), 0.08  # glass lets light through, or mirrors it away
_STOREY_M, _SILL_M, _PANE_M = 3.1, 1.0, 1.4  # a floor's height, and of a band of windows the lower edge and height
_BESIDE_M, _BEFORE_M = 0.6, 0.02  # from a corner to the glass, and of the glass from the wall
_TILES, _RISE, _STEEPEST_M = (126, 74, 60), 0.35, 5.0  # a gable's rise, in widths and at most
_BARK, _LEAVES = (92, 70, 52), (70, 104, 58)
_TRUNK_M = 0.2  # radius
_CROWN = 2 / 3  # share of a tree's height with leaves
_SAMPLE_M = 1.0  # along lines; no lane is so narrow
_WALL_COLOR, _WALL_M = (158, 148, 134), 0.25
_SAME_PLACE = "along must lead from point to point, each another place than the one before"


class Block(NamedTuple):
    """A building or wall.

    Attributes:
        outlines: (K, 2) m, counter-clockwise.
        parts: meshes.
    """

    outlines: list[Floats]
    parts: list[StaticPart]


def build_block(
    building: MapBuilding, number: int, root: Entry, middles: MiddleLines, terrain: Terrain | None = None
) -> Block:
    """Build a block with its windows and roof; `number`, its place in the list, decides the colour if none is given."""
    entry, height_m = root.part("buildings", number), float(building.height_m)
    outline = convex(building.outline, entry.part("outline"), "write a building of another shape as several")
    middles.require_off_roads(along_outline(outline), "outline", "buildings", number, "outline")
    color = PAINTS[number % len(PAINTS)] if building.color is None else COLORS[building.color]
    box = box_around(outline, 0.0, height_m)[None]
    block = StaticPart("building", *prism(outline, 0.0, height_m), color, _REFLECTIVITY, closed=True, boxes=box)
    parts = [block]
    if building.windows:
        parts += _windows(outline, height_m)
    if building.roof == "gable":
        if len(outline) != 4:
            message = f"roof must be flat on an outline of {len(outline)} corners, got 'gable'"
            raise entry.part("roof").error(message)
        parts.append(_gable(outline, height_m))
    return Block([outline], parts if terrain is None else [terrain.standing(part, outline) for part in parts])


def build_wall(wall: MapWall, number: int, root: Entry, middles: MiddleLines, terrain: Terrain | None = None) -> Block:
    """Build a wall of the same height over the ground along a line."""
    line, height_m = np.array(wall.along, dtype=np.float64), float(wall.height_m)
    thick_m = _WALL_M if wall.thickness_m is None else float(wall.thickness_m)
    steps = np.diff(line, axis=0)
    length_m = exact.hypot(steps[:, 0], steps[:, 1])
    if not length_m.all():
        raise root.part("walls", number, "along").error(_SAME_PLACE)
    if terrain is not None:
        pieces = divided(np.stack([line[:-1], line[1:]], axis=1), CELL_M / 2)
        line = np.concatenate([pieces[:, 0], line[-1:]])
        steps = np.diff(line, axis=0)
        length_m = exact.hypot(steps[:, 0], steps[:, 1])
    ahead = steps / length_m[:, None] * thick_m / 2
    aside = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    start, end = line[:-1] - ahead, line[1:] + ahead  # the pieces overlap at corners
    outlines = list(np.stack([start - aside, end - aside, end + aside, start + aside], axis=1))
    for outline in outlines:
        middles.require_off_roads(along_outline(outline), "the side of the wall", "walls", number, "along")
    prisms = [prism(outline, 0.0, height_m) for outline in outlines]
    vertices = np.concatenate([vertices for vertices, _ in prisms])
    faces = np.concatenate([faces + 8 * k for k, (_, faces) in enumerate(prisms)])
    boxes = np.array([box_around(outline, 0.0, height_m) for outline in outlines])
    part = StaticPart("wall", vertices, faces, _WALL_COLOR, _REFLECTIVITY, closed=True, boxes=boxes)
    return Block(outlines, [part if terrain is None else terrain.along(part)])


def _windows(outline: Floats, height_m: float) -> list[StaticPart]:
    """Build a band of glass on every storey of every side that is wide enough."""
    following = np.concatenate([outline[1:], outline[:1]])
    edges = following - outline
    length_m = exact.hypot(edges[:, 0], edges[:, 1])
    wide = length_m > 3 * _BESIDE_M
    sills_m = np.arange(int((height_m + _STOREY_M - _SILL_M - _PANE_M - 0.3) / _STOREY_M)) * _STOREY_M + _SILL_M
    if not wide.any() or not len(sills_m):
        return []
    along = (edges / length_m[:, None])[wide]
    outward = np.column_stack([along[:, 1], -along[:, 0]]) * _BEFORE_M
    ends = [outline[wide] + _BESIDE_M * along + outward, following[wide] - _BESIDE_M * along + outward]
    corners = np.stack([ends[0], ends[1], ends[1], ends[0]], axis=1)  # (E, 4, 2)
    heights_m = sills_m[:, None] + [0.0, 0.0, _PANE_M, _PANE_M]  # (S, 4)
    panes = np.empty((len(sills_m), len(corners), 4, 3))
    panes[..., :2], panes[..., 2] = corners, heights_m[:, None]
    first = 4 * np.arange(len(sills_m) * len(corners))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    none = np.zeros((0, 7))
    return [StaticPart("window", panes.reshape(-1, 3), faces, _GLASS, _GLASS_REFLECTIVITY, closed=False, boxes=none)]


def _gable(outline: Floats, height_m: float) -> StaticPart:
    """Build a roof on four walls; its ridge is along the longer sides."""
    sides_m = exact.hypot(*(np.concatenate([outline[1:], outline[:1]]) - outline).T)
    corners = outline if sides_m[0] + sides_m[2] >= sides_m[1] + sides_m[3] else np.roll(outline, -1, axis=0)
    rise_m = min(_RISE * float(min(sides_m[0] + sides_m[2], sides_m[1] + sides_m[3])) / 2, _STEEPEST_M)
    ridge = np.array([corners[[0, 3]].mean(axis=0), corners[[1, 2]].mean(axis=0)])
    heights_m = np.repeat([height_m, height_m + rise_m], [4, 2])
    vertices = np.column_stack([np.vstack([corners, ridge]), heights_m])
    faces = np.array([[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [3, 0, 4], [1, 2, 5], [0, 2, 1], [0, 3, 2]])
    # Half as high, the box hides about as much.
    box = box_around(outline, height_m, height_m + rise_m / 2)[None]
    return StaticPart("roof", vertices, faces, _TILES, 0.35, closed=True, boxes=box)


def prism(outline: Floats, low_m: float, high_m: float) -> tuple[Floats, Ints]:
    """Return vertices and faces of walls on a convex outline (K, 2) m, counter-clockwise, with floor and roof."""
    count = len(outline)
    vertices = np.empty((2 * count, 3))
    vertices[:count, :2] = vertices[count:, :2] = outline
    vertices[:count, 2], vertices[count:, 2] = low_m, high_m
    return vertices, _prism_faces(count)


def box_around(outline: Floats, low_m: float, high_m: float) -> Floats:
    """Return the box (7,) over the smallest rectangle around a convex outline (K, 2) m, from one height to another.

    One side of that rectangle lies along one of the outline (Freeman and Shapira 1975).
    """
    return _box_around(np.ascontiguousarray(outline), low_m, high_m)


@njit(cache=True, nogil=True)
def _box_around(outline: Floats, low_m: float, high_m: float) -> Floats:
    best, least_m2 = np.zeros(7), np.inf
    for k in range(len(outline)):
        after = (k + 1) % len(outline)
        edge_x, edge_y = outline[after, 0] - outline[k, 0], outline[after, 1] - outline[k, 1]
        edge_m = exact.hypot(edge_x, edge_y)
        cos, sin = edge_x / edge_m, edge_y / edge_m
        first, last, right, left = np.inf, -np.inf, np.inf, -np.inf
        for n in range(len(outline)):
            along, aside = outline[n, 0] * cos + outline[n, 1] * sin, outline[n, 1] * cos - outline[n, 0] * sin
            first, last, right, left = min(first, along), max(last, along), min(right, aside), max(left, aside)
        x, y, length_m, width_m = (first + last) / 2, (right + left) / 2, last - first, left - right
        if length_m * width_m < least_m2:
            least_m2 = length_m * width_m
            best[0], best[1], best[2] = x * cos - y * sin, x * sin + y * cos, (low_m + high_m) / 2
            best[3], best[4], best[5] = length_m, width_m, high_m - low_m
            best[6] = exact.arctan2(sin, cos)
    return best


@lru_cache(maxsize=32)
def _prism_faces(count: int) -> Ints:
    here, fan = np.arange(count), np.arange(1, count - 1)
    there = np.roll(here, -1)
    faces = np.vstack(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
            np.column_stack([np.zeros_like(fan), fan + 1, fan]),
            np.column_stack([np.full_like(fan, count), fan + count, fan + 1 + count]),
        ]
    )
    faces.setflags(write=False)
    return faces


def build_tree(tree: MapTree, number: int, middles: MiddleLines, terrain: Terrain | None = None) -> list[StaticPart]:
    """Build a trunk and a crown."""
    at = np.array(tree.at, dtype=np.float64)
    middles.require_off_roads(at[None], "at", "trees", number, "at")
    height_m = 9.0 if tree.height_m is None else float(tree.height_m)
    crown_m = 5.0 if tree.crown_m is None else float(tree.crown_m)
    low_m = height_m * (1 - _CROWN)
    trunk_size = np.array([2 * _TRUNK_M, 2 * _TRUNK_M, low_m + 0.5])
    crown_size = np.array([crown_m, crown_m, height_m * _CROWN])
    parts = [
        _part("trunk", _cylinder(), np.array([*at, trunk_size[2] / 2]), trunk_size, _BARK, 0.3),
        _part("leaves", _ball(), np.array([*at, (height_m + low_m) / 2]), crown_size, _LEAVES, 0.45),
    ]
    return parts if terrain is None else [terrain.standing(part, at[None]) for part in parts]


def _part(
    name: str,
    shape: tuple[Floats, Ints],
    middle: Floats,
    size: Floats,
    color: tuple[int, int, int],
    reflectivity: float,
) -> StaticPart:
    """Build a part of a shape whose sides are 1 m."""
    box = np.array([[*middle, *size, 0.0]])
    return StaticPart(name, shape[0] * size + middle, shape[1], color, reflectivity, closed=True, boxes=box)


@lru_cache(maxsize=1)
def _cylinder() -> tuple[Floats, Ints]:
    vertices, faces = cylinder(0.5, 1.0, sections=6)
    return vertices - np.array([0.0, 0.0, 0.5]), faces


@lru_cache(maxsize=1)
def _ball() -> tuple[Floats, Ints]:
    vertices, faces = ball()
    return vertices / 2, faces


def require_kinds(entry: Entry) -> None:
    """Raise an error if a piece of the list `furniture` is of no kind, or has keys or sizes that its kind has not."""
    for item in entry.entries():
        if "kind" not in (named := item.named()):
            raise item.error(f"kind is missing in furniture. Accepted: {', '.join(KINDS)}")
        kind = KINDS[named["kind"].choice(KINDS, "kind of furniture")]
        fields = item.fields(("kind", "along") if kind.along else ("kind", "at", "heading_deg"), tuple(kind.sizes))
        if kind.along:
            fields["along"].polyline(2)
        for name, size in kind.sizes.items():
            if name in fields:
                fields[name].checked(require_between, size.least, size.most)


def require_furniture_off_roads(pieces: Sequence[MapFurniture], root: Entry, middles: MiddleLines) -> None:
    """Raise an error if a piece of furniture stands on a road, or has no length, or a stem longer than all of it."""
    for k, piece in enumerate(pieces):
        item = root.part("furniture", k)
        if piece.along and not np.diff(np.array(piece.along), axis=0).any(axis=1).all():
            raise item.part("along").error(_SAME_PLACE)
        if "stem_m" in KINDS[piece.kind].sizes and size_m(piece, "stem_m") >= size_m(piece, "height_m"):
            raise item.error("stem_m must be less than height_m: the crown is between them")
    ground = [_ground(piece, KINDS[piece.kind]) for piece in pieces]
    if ground and middles.are_met(np.concatenate(ground)):  # in one go: a town has hundreds of pieces
        for k, points in enumerate(ground):
            middles.require_off_roads(points, "furniture", "furniture", k)


def _ground(piece: MapFurniture, kind: Kind) -> Floats:
    """Return points (N, 2) m that must not be on a road."""
    if kind.along:
        points = np.array(piece.along, dtype=np.float64)
        return np.concatenate([line_pieces(points, _SAMPLE_M)[0], points])
    at = np.array([piece.at], dtype=np.float64)
    corners = rectangle_at(at, np.array(kind.ground_m), float(np.radians(piece.heading_deg or 0.0)))
    return np.concatenate([at, corners])
