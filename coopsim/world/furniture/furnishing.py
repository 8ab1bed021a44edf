"""Meshes of a place's furniture, from entries as they are written in files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.furniture.kinds import KINDS, Kind, model
from coopsim.world.furniture.piece import Shape
from coopsim.world.snapshot import StaticPart

FurnitureEntry = Mapping[str, Any]
"""A piece: `kind`, `at` and `heading_deg`, or `along` for kinds that stand along a line; and sizes of the kind."""

Heights = Callable[[Floats], Floats]
"""Heights (N,) m of the ground at points (N, 2) m."""

_VARIANTS = 12
_ROUNDED_M = 0.05  # of lengths along lines, so that most pieces share a mesh

_Key = tuple[str, tuple[float, ...], int]
_Stand = tuple[float, float, float]
"""Place x, y (m) and heading (rad)."""
_Placed = tuple[str, Shape, int]
"""Kind, a shape of its model, and number of the place where it stands."""


def furnishing_parts(
    entries: Sequence[FurnitureEntry], relief_heights: Heights | None = None
) -> tuple[StaticPart, ...]:
    """Build the meshes of furniture.

    Args:
        entries: that `read_furniture` accepts. An entry's variant depends on its number in the list.
        relief_heights: of the ground on which they stand; None: 0 everywhere.
    """
    stands: dict[_Key, list[_Stand]] = {}
    for number, entry in enumerate(entries):
        for key, stand in _pieces(entry, 7 * number):
            stands.setdefault(key, []).append(stand)
    poses = [np.array(each) for each in stands.values()]
    spots = np.concatenate([np.zeros((0, 3)), *poses])
    ground = np.zeros(len(spots)) if relief_heights is None else relief_heights(spots[:, :2])
    placed, first = list[_Placed](), 0
    for (kind, sizes, variant), pose in zip(stands, poses, strict=True):
        numbers = range(first, first + len(pose))
        placed += [(kind, shape, number) for shape in model(kind, sizes, variant) for number in numbers]
        first += len(pose)
    return _parts(placed, spots, ground)


def sizes_of(kind: Kind, entry: FurnitureEntry) -> tuple[float, ...]:
    """Return the sizes of an entry in the order of the kind's, m."""
    return tuple(float(entry.get(name, size.usual)) for name, size in kind.sizes.items())


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


def _pieces(entry: FurnitureEntry, variant: int) -> list[tuple[_Key, _Stand]]:
    """Return keys of the models of an entry, and where they stand."""
    name = entry["kind"]
    kind = KINDS[name]
    sizes = sizes_of(kind, entry)
    if not kind.along:
        x, y = entry["at"]
        return [((name, sizes, variant % _VARIANTS), (x, y, np.radians(entry["heading_deg"])))]
    middles, headings, lengths = line_pieces(np.array(entry["along"], dtype=np.float64), kind.step_m)
    rounded = np.maximum(np.round(lengths / _ROUNDED_M), 1.0) * _ROUNDED_M
    # Steps of three keep the colour, which goes by thirds, and change the leaves.
    return [
        ((name, (float(length), *sizes), (variant + 3 * k) % _VARIANTS), (x, y, heading))
        for k, ((x, y), heading, length) in enumerate(
            zip(middles.tolist(), headings.tolist(), rounded.tolist(), strict=True)
        )
    ]


def _parts(placed: Sequence[_Placed], poses: Floats, ground_m: Floats) -> tuple[StaticPart, ...]:
    """Return shapes at poses (M, 3), on ground of heights (M,) m; all in one go, as a town has a thousand."""
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
