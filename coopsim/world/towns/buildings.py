"""Buildings: ground plans of convex parts, and the kinds of lots on which they stand.

A plan has its front along x, from 0 to its width, and leads away from the street along y, from 0 to its depth, m.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import rectangle

_SLIT_M = 0.02  # between parts: faces in one plane would flicker


class Part(NamedTuple):
    """Part of a building: a convex outline (K, 2) m, and its share of the building's height."""

    outline: Floats
    height: float = 1.0


Shape = Callable[[float, float, np.random.Generator], list[Part]]
"""Function that draws the parts of a building from its width and depth, m, and random numbers."""


def plain(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a rectangle."""
    return [Part(rectangle((0.0, width_m), (0.0, depth_m)))]


def cut(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a rectangle with one or both corners at the front cut off."""
    corner_m = min(width_m, depth_m) * rng.uniform(0.15, 0.35)
    right = [[width_m - corner_m, 0.0], [width_m, corner_m]] if rng.random() < 0.6 else [[width_m, 0.0]]
    return [Part(np.array([[0.0, corner_m], [corner_m, 0.0], *right, [width_m, depth_m], [0.0, depth_m]]))]


def with_bay(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a rectangle with a bay window or porch in front of it."""
    out_m, half_m = min(1.4, 0.15 * depth_m), width_m * rng.uniform(0.12, 0.2)
    at = width_m * rng.uniform(0.3, 0.7)
    front = np.array([[at - half_m, out_m], [at - 0.6 * half_m, 0], [at + 0.6 * half_m, 0], [at + half_m, out_m]])
    house = rectangle((0.0, width_m), (out_m + _SLIT_M, depth_m))
    return [Part(house), Part(front, float(rng.uniform(0.45, 0.95)))]


def l_shape(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a front and a wing behind one end of it."""
    front_m, wing_m = depth_m * rng.uniform(0.4, 0.55), width_m * rng.uniform(0.3, 0.45)
    x = (0.0, wing_m) if rng.random() < 0.5 else (width_m - wing_m, width_m)
    wing = rectangle(x, (front_m + _SLIT_M, depth_m))
    return [Part(rectangle((0.0, width_m), (0.0, front_m))), Part(wing, float(rng.uniform(0.5, 1.0)))]


def u_shape(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a front with two wings around a courtyard, which opens to the back or to the street."""
    front_m, wing_m = depth_m * rng.uniform(0.35, 0.45), width_m * rng.uniform(0.25, 0.32)
    y = front_m + _SLIT_M, depth_m
    height = float(rng.uniform(0.6, 1.0))
    parts = [Part(rectangle((0.0, width_m), (0.0, front_m))), Part(rectangle((0.0, wing_m), y), height)]
    parts.append(Part(rectangle((width_m - wing_m, width_m), y), height))
    if rng.random() < 0.4:
        parts = [Part(part.outline * [1.0, -1.0] + [0.0, depth_m], part.height) for part in parts]
    return parts


def around_courtyard(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return four wings around a closed courtyard."""
    wing_m = min(width_m, depth_m) * rng.uniform(0.26, 0.32)
    low, high = wing_m + _SLIT_M, depth_m - wing_m - _SLIT_M
    back = float(rng.uniform(0.6, 1.0))
    return [
        Part(rectangle((0.0, width_m), (0.0, wing_m))),
        Part(rectangle((0.0, width_m), (depth_m - wing_m, depth_m)), back),
        Part(rectangle((0.0, wing_m), (low, high))),
        Part(rectangle((width_m - wing_m, width_m), (low, high)), back),
    ]


def terrace(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return houses wall to wall, of different depths and heights."""
    count = max(2, round(width_m / rng.uniform(6.0, 9.0)))
    edges = np.linspace(0.0, width_m, count + 1)
    edges[1:-1] += rng.uniform(-0.8, 0.8, count - 1)
    fronts = np.where(rng.random(count) < 0.25, rng.uniform(0.3, 1.2, count), 0.0)
    depths, heights = depth_m * rng.uniform(0.75, 1.0, count), rng.choice([0.75, 0.85, 1.0, 1.0], count)
    return [
        Part(rectangle((edges[k] + _SLIT_M / 2, edges[k + 1] - _SLIT_M / 2), (fronts[k], depths[k])), float(heights[k]))
        for k in range(count)
    ]


def with_annex(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a building with a lower one at its side, such as a garage or a shop."""
    annex_m = width_m * rng.uniform(0.25, 0.35)
    y = sorted(depth_m * rng.uniform([0.0, 0.6], [0.35, 0.9]))
    main, beside = (annex_m + _SLIT_M, width_m), (0.0, annex_m)
    if rng.random() < 0.5:
        main, beside = (0.0, width_m - annex_m - _SLIT_M), (width_m - annex_m, width_m)
    return [Part(rectangle(main, (0.0, depth_m))), Part(rectangle(beside, (y[0], y[1])), float(rng.uniform(0.35, 0.5)))]


def many_sided(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a tower of six or eight sides."""
    count = int(rng.choice([6, 8]))
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    corners = np.column_stack([width_m * (1 + exact.cos(angle)), depth_m * (1 + exact.sin(angle))]) / 2
    return [Part(corners)]


def church(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a tower at the street, a nave behind it and a choir of three sides."""
    tower_m, choir_m = 0.45 * width_m, 0.35 * width_m
    low, high = (width_m - tower_m) / 2, (width_m + tower_m) / 2
    nave = rectangle((0.0, width_m), (tower_m + _SLIT_M, depth_m - choir_m))
    back = depth_m - choir_m + _SLIT_M
    quarter_m = 0.3 * width_m
    choir = [[0.12 * width_m, back], [0.88 * width_m, back], [width_m - quarter_m, depth_m], [quarter_m, depth_m]]
    return [Part(rectangle((low, high), (0.0, tower_m))), Part(nave, 0.45), Part(np.array(choir), 0.35)]


COLORS = ("brick", "sand", "slate", "ochre", "white", "white", "rose", "sage", "umber", "concrete")
"""Colours of buildings, as often as they are named; see `coopsim.world.custom.scenery`."""

_STOREY_M = 3.1


class LotKind(NamedTuple):
    """Kind of lot; pairs are least and greatest.

    Attributes:
        weights: relative frequency in a town of openness 0, 0.5 and 1.
        width_m: width of the building.
        depth_m: depth of the building.
        gap_m: distance to the next building.
        setback_m: distance from the border, in a town of openness 0.
        opens_m: added to `setback_m` in a town of openness 1.
        storeys: number.
        shapes: ground plans.
        front: ground before the building: "yard" (paved), "garden" (often with a wall and a driveway) or "lawn".
        gables: share with gabled roofs; others are flat.
        windows: share with bands of glass on every storey.
    """

    weights: tuple[float, float, float]
    width_m: tuple[float, float]
    depth_m: tuple[float, float]
    gap_m: tuple[float, float]
    setback_m: tuple[float, float]
    opens_m: float
    storeys: tuple[int, int]
    shapes: tuple[Shape, ...]
    front: str
    gables: float = 0.0
    windows: float = 0.9

    def draw_height_m(self, rng: np.random.Generator) -> float:
        """Draw the height of a building."""
        return float(_STOREY_M * rng.integers(self.storeys[0], self.storeys[1] + 1) + rng.uniform(0.3, 1.6))

    def draw_setback_m(self, openness: float, rng: np.random.Generator) -> float:
        """Draw the distance of a building from the border of its ground."""
        least_m = 0.02 + rng.uniform(*self.setback_m)
        return float(least_m + rng.uniform(0.3, 1.0) * self.opens_m * openness * np.sqrt(openness))

    def draw_style(self, rng: np.random.Generator) -> dict[str, Any]:
        """Draw further keys of a building: colour, windows, roof."""
        gable, glass, color = rng.random() < self.gables, rng.random() < self.windows, rng.choice(COLORS)
        return {"color": str(color)} | ({"windows": True} if glass else {}) | ({"roof": "gable"} if gable else {})


_HOUSES = (plain, with_bay, l_shape, with_annex, with_annex)
_BLOCKS = (plain, cut, l_shape, u_shape, with_bay)

KINDS = {
    "closed": LotKind((5, 1.5, 0), (12, 28), (10, 14), (0.05, 0.05), (0, 0.6), 4, (3, 6), _BLOCKS, "yard", 0.2),
    "courtyard": LotKind(
        (1.2, 0.6, 0.1),
        (26, 38),
        (24, 32),
        (0.05, 6),
        (0, 2),
        12,
        (3, 5),
        (around_courtyard, u_shape),
        "yard",
    ),
    "terrace": LotKind((2.5, 2, 0.3), (18, 40), (9, 12), (1.2, 5), (0.1, 4), 6, (2, 3), (terrace,), "garden", 0.8, 0.7),
    "villa": LotKind((0.5, 3, 2.0), (8, 14), (8, 12), (4.5, 9), (3, 7), 9, (1, 3), _HOUSES, "garden", 0.7, 0.5),
    "slab": LotKind((0.2, 1, 2.0), (28, 46), (10, 13), (8, 18), (6, 10), 14, (4, 9), (plain,), "lawn"),
    "tower": LotKind((0.1, 0.4, 0.8), (16, 22), (16, 22), (8, 20), (4, 8), 16, (8, 15), (many_sided, plain), "lawn"),
    "hall": LotKind((0.3, 0.8, 0.8), (22, 40), (18, 30), (6, 14), (7, 14), 10, (1, 2), (plain,), "yard", 0.0, 0.2),
    "park": LotKind((0.05, 0.4, 2.5), (20, 45), (5, 6), (2, 4), (4, 6), 0, (1, 1), (), "lawn"),
}
"""Kinds by name; `park` has no building."""

CHURCH = LotKind((0, 0, 0), (11, 14), (28, 36), (4, 8), (3, 9), 10, (8, 10), (church,), "yard", 0.0, 0.0)


def draw_kind(openness: float, rng: np.random.Generator) -> str:
    """Draw the name of a kind."""
    return str(rng.choice(list(KINDS), p=_shares(openness)))


@lru_cache(4)
def _shares(openness: float) -> Floats:
    """Return the shares of the kinds among lots; not to be changed."""
    weights = np.array([np.interp(openness, (0.0, 0.5, 1.0), kind.weights) for kind in KINDS.values()])
    shares: Floats = weights / weights.sum()
    return shares
