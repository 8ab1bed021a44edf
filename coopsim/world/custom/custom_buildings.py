"""Buildings and walls from a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_flag
from coopsim.world.custom.clearance import Kerbs, along_outline
from coopsim.world.custom.convex import read_convex
from coopsim.world.custom.hulls import box_around, prism
from coopsim.world.places.scenery import PAINTS
from coopsim.world.snapshot import StaticPart

COLORS: Mapping[str, tuple[int, int, int]] = {
    **dict(zip(("brick", "sand", "slate", "ochre"), PAINTS, strict=True)),
    "white": (222, 220, 212),
    "rose": (204, 158, 146),
    "sage": (158, 170, 146),
    "umber": (124, 98, 80),
    "concrete": (160, 158, 152),
}
"""Colours of buildings; without one they have the first four by turns."""

_REFLECTIVITY = 0.4
_GLASS, _GLASS_REFLECTIVITY = (66, 80, 94), 0.08  # glass lets light through, or mirrors it away
_STOREY_M, _SILL_M, _PANE_M = 3.1, 1.0, 1.4  # a floor's height, and of a band of windows the lower edge and height
_BESIDE_M, _BEFORE_M = 0.6, 0.02  # from a corner to the glass, and of the glass from the wall
_TILES, _RISE, _STEEPEST_M = (126, 74, 60), 0.35, 5.0  # a gable's rise, in widths and at most
_WALL_COLOR, _WALL_M = (158, 148, 134), 0.25


class Building(NamedTuple):
    """A building or wall.

    Attributes:
        outlines: (K, 2) m, counter-clockwise.
        parts: meshes.
    """

    outlines: list[Floats]
    parts: list[StaticPart]


def read_building(entry: Entry, number: int, kerbs: Kerbs) -> Building:
    """Return a block with its windows and roof; `number` decides the colour if the file gives none."""
    fields = entry.fields(("outline", "height_m"), ("windows", "roof", "color"))
    height_m = float(fields["height_m"].checked(require_between, 0.2, 500))
    outline = read_convex(fields["outline"], "write a building of another shape as several")
    kerbs.require_beside(along_outline(outline), fields["outline"], "outline")
    color = COLORS[fields["color"].choice(COLORS)] if "color" in fields else PAINTS[number % len(PAINTS)]
    box = box_around(outline, 0.0, height_m)[None]
    block = StaticPart("building", *prism(outline, 0.0, height_m), color, _REFLECTIVITY, closed=True, boxes=box)
    parts = [block]
    if "windows" in fields and fields["windows"].checked(require_flag):
        parts += _windows(outline, height_m)
    if "roof" in fields and fields["roof"].choice(("flat", "gable")) == "gable":
        if len(outline) != 4:
            raise fields["roof"].error(f"roof must be flat on an outline of {len(outline)} corners, got 'gable'")
        parts.append(_gable(outline, height_m))
    return Building([outline], parts)


def read_wall(entry: Entry, kerbs: Kerbs) -> Building:
    """Return a wall of the same height along a line."""
    fields = entry.fields(("along", "height_m"), ("thickness_m",))
    line = fields["along"].points(2)
    height_m = float(fields["height_m"].checked(require_between, 0.2, 20))
    thick_m = float(fields["thickness_m"].checked(require_between, 0.05, 2)) if "thickness_m" in fields else _WALL_M
    steps = np.diff(line, axis=0)
    length_m = exact.hypot(steps[:, 0], steps[:, 1])
    if not length_m.all():
        raise fields["along"].error("along must lead from point to point, each another place than the one before")
    ahead = steps / length_m[:, None] * thick_m / 2
    aside = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    start, end = line[:-1] - ahead, line[1:] + ahead  # the pieces overlap at corners
    outlines = list(np.stack([start - aside, end - aside, end + aside, start + aside], axis=1))
    for outline in outlines:
        kerbs.require_beside(along_outline(outline), fields["along"], "the side of the wall")
    pieces = [prism(outline, 0.0, height_m) for outline in outlines]
    vertices = np.concatenate([vertices for vertices, _ in pieces])
    faces = np.concatenate([faces + 8 * k for k, (_, faces) in enumerate(pieces)])
    boxes = np.array([box_around(outline, 0.0, height_m) for outline in outlines])
    part = StaticPart("wall", vertices, faces, _WALL_COLOR, _REFLECTIVITY, closed=True, boxes=boxes)
    return Building(outlines, [part])


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
