"""Trees from a file."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between
from coopsim.types import Ints
from coopsim.world.custom.clearance import Kerbs
from coopsim.world.snapshot import StaticPart

_BARK, _LEAVES = (92, 70, 52), (70, 104, 58)
_TRUNK_M = 0.2  # radius
_CROWN = 2 / 3  # share of a tree's height with leaves


def read_tree(entry: Entry, kerbs: Kerbs) -> list[StaticPart]:
    """Build a trunk and a crown."""
    fields = entry.fields(("at",), ("height_m", "crown_m"))
    at = fields["at"].point()
    kerbs.require_beside(at[None], fields["at"], "at")
    height_m = float(fields["height_m"].checked(require_between, 2, 60)) if "height_m" in fields else 9.0
    crown_m = float(fields["crown_m"].checked(require_between, 0.5, 30)) if "crown_m" in fields else 5.0
    low_m = height_m * (1 - _CROWN)
    trunk_size = np.array([2 * _TRUNK_M, 2 * _TRUNK_M, low_m + 0.5])
    crown_size = np.array([crown_m, crown_m, height_m * _CROWN])
    return [
        _part("trunk", _cylinder(), np.array([*at, trunk_size[2] / 2]), trunk_size, _BARK, 0.3),
        _part("leaves", _ball(), np.array([*at, (height_m + low_m) / 2]), crown_size, _LEAVES, 0.45),
    ]


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
    mesh = trimesh.creation.cylinder(0.5, height=1.0, sections=6)
    return exact.settled(mesh.vertices), np.asarray(mesh.faces)


@lru_cache(maxsize=1)
def _ball() -> tuple[Floats, Ints]:
    mesh = trimesh.creation.icosphere(subdivisions=1)
    return exact.settled(mesh.vertices) / 2, np.asarray(mesh.faces)
