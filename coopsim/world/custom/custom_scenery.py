"""Buildings and trees from a file."""

from __future__ import annotations

import numpy as np
import trimesh

from coopsim.config.entry import Entry
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between
from coopsim.world.custom.clearance import Kerbs, along_outline
from coopsim.world.places.scenery import PAINTS
from coopsim.world.snapshot import StaticPart

_BARK, _LEAVES = (92, 70, 52), (70, 104, 58)
_TRUNK_M = 0.2  # radius
_CROWN = 2 / 3  # share of a tree's height with leaves


def read_building(entry: Entry, number: int, kerbs: Kerbs) -> tuple[Floats, StaticPart]:
    """Return an outline (K, 2) m, counter-clockwise, and the block on it."""
    fields = entry.fields(("outline", "height_m"))
    outline = fields["outline"].points(3)
    height_m = float(fields["height_m"].checked(require_between, 0.2, 500))
    edges = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    once_round = np.isclose(abs(_turned_rad(edges)), 2 * np.pi)
    if not once_round or not ((turns > 0).all() or (turns < 0).all()):
        raise fields["outline"].error(
            "outline must be convex, without corners of 180 degrees: write a building of another shape as several"
        )
    kerbs.require_beside(along_outline(outline), fields["outline"], "outline")
    if turns[0] < 0:
        outline = outline[::-1]
    return outline, _block(outline, height_m, PAINTS[number % len(PAINTS)])


def read_tree(entry: Entry, kerbs: Kerbs) -> list[StaticPart]:
    """Build a trunk and a crown."""
    fields = entry.fields(("at",), ("height_m", "crown_m"))
    kerbs.require_beside(fields["at"].point()[None], fields["at"], "at")
    x, y = fields["at"].point().tolist()
    height_m = float(fields["height_m"].checked(require_between, 2, 60)) if "height_m" in fields else 9.0
    crown_m = float(fields["crown_m"].checked(require_between, 0.5, 30)) if "crown_m" in fields else 5.0
    low_m = height_m * (1 - _CROWN)
    trunk = trimesh.creation.cylinder(_TRUNK_M, segment=np.array([[x, y, 0.0], [x, y, low_m + 0.5]]), sections=6)
    crown = trimesh.creation.icosphere(subdivisions=1)
    leaves = crown.vertices * [crown_m / 2, crown_m / 2, height_m * _CROWN / 2] + [x, y, (height_m + low_m) / 2]
    return [
        StaticPart("trunk", np.asarray(trunk.vertices), np.asarray(trunk.faces), _BARK, 0.3),
        StaticPart("leaves", np.asarray(leaves), np.asarray(crown.faces), _LEAVES, 0.45),
    ]


def _turned_rad(edges: Floats) -> float:
    """Return the total turn along closed edges (K, 2)."""
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    turn = np.roll(heading, -1) - heading
    return float(((turn + np.pi) % (2 * np.pi) - np.pi).sum())


def _block(outline: Floats, height_m: float, paint: tuple[int, int, int]) -> StaticPart:
    """Build upright walls on a convex outline (K, 2) m, counter-clockwise, with a floor and a roof."""
    count = len(outline)
    here, fan = np.arange(count), np.arange(1, count - 1)
    there = np.roll(here, -1)
    vertices = np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (0.0, height_m)])
    faces = np.vstack(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
            np.column_stack([np.zeros_like(fan), fan + 1, fan]),
            np.column_stack([np.full_like(fan, count), fan + count, fan + 1 + count]),
        ]
    )
    return StaticPart("building", vertices, faces, paint, 0.4)
