"""Kinds of ground along streets: how wide it is, what is built on it, and how far from the street."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.towns.beside import building_shapes as shapes

COLORS = ("brick", "sand", "slate", "ochre", "white", "white", "rose", "sage", "umber", "concrete")
"""Colours of buildings, as often as they are named; see `coopsim.world.custom.scenery`."""

_STOREY_M = 3.1


class LotKind(NamedTuple):
    """A kind of lot; pairs are least and greatest.

    Attributes:
        weights: how frequent it is in a town of openness 0, 0.5 and 1.
        width_m: of the building.
        depth_m: of the building.
        gap_m: to the next one.
        setback_m: of the building from the border, in a town of openness 0; in one of 1 it is `opens_m` more.
        opens_m: see `setback_m`.
        storeys: number.
        shapes: ground plans.
        front: what is before the building: "yard" (paved), "garden" (often with a wall and a driveway) or "lawn".
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
    shapes: tuple[shapes.Shape, ...]
    front: str
    gables: float = 0.0
    windows: float = 0.9


_HOUSES = (shapes.plain, shapes.with_bay, shapes.l_shape, shapes.with_annex, shapes.with_annex)
_BLOCKS = (shapes.plain, shapes.cut, shapes.l_shape, shapes.u_shape, shapes.with_bay)

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
        (shapes.around_courtyard, shapes.u_shape),
        "yard",
    ),
    "terrace": LotKind(
        (2.5, 2, 0.3), (18, 40), (9, 12), (1.2, 5), (0.1, 4), 6, (2, 3), (shapes.terrace,), "garden", 0.8, 0.7
    ),
    "villa": LotKind((0.5, 3, 2.0), (8, 14), (8, 12), (4.5, 9), (3, 7), 9, (1, 3), _HOUSES, "garden", 0.7, 0.5),
    "slab": LotKind((0.2, 1, 2.0), (28, 46), (10, 13), (8, 18), (6, 10), 14, (4, 9), (shapes.plain,), "lawn"),
    "tower": LotKind(
        (0.1, 0.4, 0.8), (16, 22), (16, 22), (8, 20), (4, 8), 16, (8, 15), (shapes.many_sided, shapes.plain), "lawn"
    ),
    "hall": LotKind(
        (0.3, 0.8, 0.8), (22, 40), (18, 30), (6, 14), (7, 14), 10, (1, 2), (shapes.plain,), "yard", 0.0, 0.2
    ),
    "park": LotKind((0.05, 0.4, 2.5), (20, 45), (5, 6), (2, 4), (4, 6), 0, (1, 1), (), "lawn"),
}
"""Kinds by name; of `park`, nothing is built."""

CHURCH = LotKind((0, 0, 0), (11, 14), (28, 36), (4, 8), (3, 9), 10, (8, 10), (shapes.church,), "yard", 0.0, 0.0)


def draw_kind(openness: float, rng: np.random.Generator) -> str:
    """Draw the name of a kind."""
    return str(rng.choice(list(KINDS), p=_shares(openness)))


@lru_cache(4)
def _shares(openness: float) -> Floats:
    """Return the shares of the kinds among lots; not to be changed."""
    weights = np.array([np.interp(openness, (0.0, 0.5, 1.0), kind.weights) for kind in KINDS.values()])
    shares: Floats = weights / weights.sum()
    return shares


def draw_height_m(kind: LotKind, rng: np.random.Generator) -> float:
    """Draw the height of a building."""
    return float(_STOREY_M * rng.integers(kind.storeys[0], kind.storeys[1] + 1) + rng.uniform(0.3, 1.6))


def draw_setback_m(kind: LotKind, openness: float, rng: np.random.Generator) -> float:
    """Draw the distance of a building from the border of its ground."""
    low, high = kind.setback_m
    return float(0.02 + rng.uniform(low, high) + rng.uniform(0.3, 1.0) * kind.opens_m * openness * np.sqrt(openness))


def draw_style(kind: LotKind, rng: np.random.Generator) -> dict[str, Any]:
    """Draw further keys of a building: colour, windows, roof."""
    gable, glass, color = rng.random() < kind.gables, rng.random() < kind.windows, rng.choice(COLORS)
    return {"color": str(color)} | ({"windows": True} if glass else {}) | ({"roof": "gable"} if gable else {})
