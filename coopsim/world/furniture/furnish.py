"""Furniture, plants and painted lines for any layout, and their meshes."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.furniture import kinds
from coopsim.world.furniture.free_ground import lanes_of, obstacles_of
from coopsim.world.furniture.placement import Placer, Plot
from coopsim.world.furniture.sides import fronts, street_sides, way_sides
from coopsim.world.furniture.signal_heads import crosswalks_without_light, head_stands, lamp_parts
from coopsim.world.furniture.solids import Shape
from coopsim.world.places.description import MapFurniture, MapTree, PlaceDescription
from coopsim.world.places.layout import MARKING, Layout, flat_part
from coopsim.world.places.relief import laid_on
from coopsim.world.places.signals import stop_bars
from coopsim.world.snapshot import StaticPart

_AROUND_M = 60.0  # beyond the ends of lanes and ways
_AHEAD_M = 1_500.0  # where traffic is kept up around cars that go on and on along x


def furnish(layout: Layout, seed: int) -> list[MapFurniture]:
    """Return furniture and plants for a layout.

    Places depend on the layout and the seed alone. Nothing stands on roads or where long vehicles sweep over their
    edges, near the lines along which people walk and ride (`free_ground.WALK_M`), on crosswalks, in bays, in buildings
    or in another piece. Numbers are rounded to millimetres.
    """
    area = area_of(layout)
    lanes, plot = lanes_of(layout, area), Plot(obstacles_of(layout, area))
    kerbs, backs = street_sides(layout, area, lanes), way_sides(layout, lanes)
    placer = Placer(seed, plot)
    if layout.signals:
        stands, head = head_stands(layout.road_map.stop_lines)
        plot.put("traffic_light", stands, head, obstacles=obstacles_of(layout, area, swept=False))
    placer.crosswalks(kerbs, crosswalks_without_light(layout), lights=not layout.signals)
    rows, lines = (kinds.VERGE, kinds.VERGE_LINES) if layout.footways is None else (kinds.KERB, kinds.KERB_LINES)
    placer.zone("kerb", rows, lines, kerbs)
    placer.fronts(*fronts(layout))
    placer.zone("back", kinds.BACK, kinds.BACK_LINES, backs)
    return plot.entries


def area_of(layout: Layout) -> Floats:
    """Return the least and greatest x and y (2, 2) m of the furnished area: all but parts of endless roads."""
    ends = [lane.position(along, 0.0) for lane in layout.network.lanes.values() for along in (0.0, lane.length)]
    if layout.window_m is not None:
        ends = [layout.network.get_lane(slot.lane).position(slot.along_m, 0.0) for slot in layout.slots]
    nodes = [] if layout.footways is None else list(layout.footways.nodes)
    points = np.array([*ends, *nodes, *(rsu.translation[:2] for rsu in layout.rsus)])
    area = np.stack([points.min(axis=0) - _AROUND_M, points.max(axis=0) + _AROUND_M])
    if layout.window_m is not None:
        area[:, 0] = area[0, 0] - layout.window_m, area[1, 0] + _AHEAD_M
    return area


_VARIANTS = 12
_ROUNDED_M = 0.05  # of lengths along lines, so that most pieces share a mesh

_Key = tuple[str, tuple[float, ...], int]
_Stand = tuple[float, float, float]
"""Place x, y (m) and heading (rad)."""
_Placed = tuple[str, Shape, int]
"""Kind, a shape of its model, and number of the place where it stands."""


def furnishing_parts(
    pieces: Sequence[MapFurniture], relief_heights: Callable[[Floats], Floats] | None = None
) -> tuple[StaticPart, ...]:
    """Build the meshes of furniture; the variant of a piece depends on its number in the list.

    `relief_heights` gives heights (N,) m of the ground at points (N, 2) m; None: 0 everywhere.
    """
    stands: dict[_Key, list[_Stand]] = {}
    for number, piece in enumerate(pieces):
        for key, stand in _pieces(piece, 7 * number):
            stands.setdefault(key, []).append(stand)
    poses = [np.array(each) for each in stands.values()]
    spots = np.concatenate([np.zeros((0, 3)), *poses])
    ground = np.zeros(len(spots)) if relief_heights is None else relief_heights(spots[:, :2])
    placed, first = list[_Placed](), 0
    for (kind, sizes, variant), pose in zip(stands, poses, strict=True):
        numbers = range(first, first + len(pose))
        placed += [(kind, shape, number) for shape in kinds.model(kind, sizes, variant) for number in numbers]
        first += len(pose)
    return _parts(placed, spots, ground)


def line_pieces(points: Floats, step_m: float) -> tuple[Floats, Floats, Floats]:
    """Divide a line through points (K, 2) m into pieces at most `step_m` long.

    Returns:
        Middles (N, 2) m, headings (N,) rad and lengths (N,) m.
    """
    middles, headings, lengths = [], [], []
    for start, end in pairwise(points):
        length = float(exact.hypot(*(end - start)))
        count = max(1, int(np.ceil(length / step_m - 1e-3)))
        share = (np.arange(count) + 0.5) / count
        middles.append(start + share[:, None] * (end - start))
        headings.append(np.full(count, exact.arctan2(end[1] - start[1], end[0] - start[0])))
        lengths.append(np.full(count, length / count))
    return np.concatenate(middles), np.concatenate(headings), np.concatenate(lengths)


def size_m(piece: MapFurniture, name: str) -> float:
    """Return a size of a piece, the usual one of its kind if it has none of its own."""
    given = getattr(piece, name)
    return float(kinds.KINDS[piece.kind].sizes[name].usual if given is None else given)


def _pieces(piece: MapFurniture, variant: int) -> list[tuple[_Key, _Stand]]:
    """Return keys of the models of a piece, and their poses."""
    name, kind = piece.kind, kinds.KINDS[piece.kind]
    sizes = tuple(size_m(piece, size) for size in kind.sizes)
    if piece.at is not None:
        x, y = piece.at
        return [((name, sizes, variant % _VARIANTS), (x, y, np.radians(piece.heading_deg or 0.0)))]
    middles, headings, lengths = line_pieces(np.array(piece.along, dtype=np.float64), kind.step_m)
    rounded = np.maximum(np.round(lengths / _ROUNDED_M), 1.0) * _ROUNDED_M
    # Steps of three keep the colour, which goes by thirds, and change the leaves.
    return [
        ((name, (float(length), *sizes), (variant + 3 * k) % _VARIANTS), (x, y, heading))
        for k, ((x, y), heading, length) in enumerate(
            zip(middles.tolist(), headings.tolist(), rounded.tolist(), strict=True)
        )
    ]


def _parts(placed: Sequence[_Placed], poses: Floats, ground_m: Floats) -> tuple[StaticPart, ...]:
    """Return shapes at poses (M, 3), on ground of heights (M,) m, all at once: a town has a thousand."""
    where = np.array([number for _, _, number in placed], dtype=np.int64)
    points, first = _moved([shape.vertices for _, shape, _ in placed], where, poses, ground_m)
    middles, first_box = _moved([shape.boxes[:, :3] for _, shape, _ in placed], where, poses, ground_m)
    boxes = np.concatenate([np.zeros((0, 7)), *(shape.boxes for _, shape, _ in placed)])
    boxes[:, :3] = middles
    boxes[:, 6] += np.repeat(poses[where, 2], np.diff(first_box))
    return tuple(
        StaticPart(kind, points[a:b], shape.faces, *shape.material, shape.closed, boxes[c:d], shape.opacity)
        for (kind, shape, _), (a, b), (c, d) in zip(
            placed, pairwise(first.tolist()), pairwise(first_box.tolist()), strict=True
        )
    )


def _moved(parts: Sequence[Floats], where: Ints, poses: Floats, ground_m: Floats) -> tuple[Floats, Ints]:
    """Return all points of parts (K, 3) m that stand at poses `where` (P,), and the first point (P + 1,) of each."""
    counts = np.array([len(part) for part in parts], dtype=np.int64)
    points = np.concatenate([np.zeros((0, 3)), *parts])
    x, y = points[:, 0].copy(), points[:, 1].copy()
    cos, sin = exact.cos(poses[:, 2]), exact.sin(poses[:, 2])
    own = np.repeat(where, counts)
    points[:, 0] = x * cos[own] - y * sin[own] + poses[own, 0]
    points[:, 1] = x * sin[own] + y * cos[own] + poses[own, 1]
    points[:, 2] += ground_m[own]
    return points, np.cumsum([0, *counts])


_STEM = 0.3  # share of a tree's height without leaves, of trees that stand by themselves


def with_furniture(layout: Layout, pieces: Sequence[MapFurniture]) -> Layout:
    """Return a layout with furniture and painted lines, on its own ground, instead of what it had."""
    heights = None if layout.relief is None else layout.relief.heights
    parts = *furnishing_parts(pieces, heights), *lamp_parts(pieces, layout, heights)
    return replace(layout, furnishing=(*lane_paint(layout), *parts))


def furnished(layout: Layout, description: PlaceDescription, seed: int) -> tuple[Layout, PlaceDescription]:
    """Add furniture to a layout and to its description, from which the same layout can be built."""
    pieces = (*(description.furniture or ()), *furnish(layout, seed))
    return with_furniture(layout, pieces), replace(description, furniture=pieces)


def furnished_for(identity: str, layout: Layout) -> Layout:
    """Return a layout with furniture that depends on its identity: a name, or all of a description as text."""
    return with_furniture(layout, furnish(layout, zlib.crc32(identity.encode())))


def leafy(description: PlaceDescription) -> PlaceDescription:
    """Return a description with its plain trees (key `trees`) as furniture, through which some rays pass."""
    if not description.trees:
        return description
    trees = tuple(_leafy(tree, number) for number, tree in enumerate(description.trees))
    return replace(description, trees=(), furniture=(*(description.furniture or ()), *trees))


def _leafy(tree: MapTree, number: int) -> MapFurniture:
    height_m, crown_m = (None if size is None else round(2 * float(size)) / 2 for size in (tree.height_m, tree.crown_m))
    usual_m = kinds.KINDS["tree"].sizes["height_m"].usual
    stem_m = round(min(max(_STEM * (usual_m if height_m is None else height_m), 0.5), kinds.YARD_STEM_M), 1)
    # Trees have no front: their branches lead in all directions.
    turned_deg = 77.0 * number % 360.0
    return MapFurniture("tree", tree.at, turned_deg, height_m=height_m, crown_m=crown_m, stem_m=stem_m)


_PAINT_M = 0.012  # over the road, more than water and stripes
_STOP_M = 0.4  # width of stop lines
_REFLECTIVITY = 0.8  # as of crosswalks; road paint has glass beads


def lane_paint(layout: Layout) -> tuple[StaticPart, ...]:
    """Build the lines that a place's map has between its lanes and before its lights, on its own ground."""
    lines = [*layout.road_map.markings, *stop_bars(layout.road_map.stop_lines, _STOP_M)]
    if not lines:
        return ()
    flat = flat_part("marking", lines, 2 * _PAINT_M, MARKING, _REFLECTIVITY)
    return (flat,) if layout.relief is None else (laid_on(flat, layout.relief.grid, _PAINT_M),)
