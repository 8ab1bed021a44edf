"""A composition in the making: furniture and bystanders at places beside a line, no two in each other.

Axes of a composition: x along the line, y outward from it, metres; angles turn from x to y.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Mask
from coopsim.world.furniture.free_ground import BULKY, CROWN, GROUND, UNPAVED
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.models import Model
from coopsim.world.surroundings.cast import Cast, Role

ALONG, OUT, BACK, IN = 0.0, np.pi / 2, np.pi, -np.pi / 2
"""Angles: with the line, away from it, against it, towards it."""

_ROOM_M = 0.05
_HIPS_FROM_BACK_M = 0.17  # of a person who sits
LOW_CROWN_M = 0.35
"""Crowns are round: the discs that stand for them are so much smaller."""


class Item(NamedTuple):
    """Piece of furniture, or bystander.

    Attributes:
        kind: kind of furniture; empty: a bystander.
        model: a bystander's model; None: furniture.
        x_m: middle along the line.
        y_m: middle outward from it.
        turn_rad: direction of the front.
        size_m: extents on the ground, ahead and across.
        layers: layers of free ground that it stands in.
        crown_m: radius of what spreads overhead.
        sizes: sizes of the furniture.
        on_seat: may stand in furniture of its composition.
    """

    kind: str
    model: Model | None
    x_m: float
    y_m: float
    turn_rad: float
    size_m: tuple[float, float]
    layers: int
    crown_m: float = 0.0
    sizes: Mapping[str, Any] = {}
    on_seat: bool = False


@dataclass(slots=True)
class Draft:
    """Composition in the making; what would stand in something else is left out.

    Attributes:
        rng: source of all draws.
        cast: models of bystanders.
        items: all so far.
        discs: discs (K, 4) that cover them: x, y, radius m, and layers.
    """

    rng: np.random.Generator
    cast: Cast
    items: list[Item] = field(default_factory=list)
    discs: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    _is_soft: Mask = field(default_factory=lambda: np.zeros(0, np.bool_))

    def add(self, item: Item) -> None:
        """Add an item if it is in none of the others."""
        own = _discs_of(item)
        apart = own[:, None, 2] + self.discs[:, 2] + _ROOM_M
        x, y = (own[:, None, axis] - self.discs[:, axis] for axis in (0, 1))
        meets = (x * x + y * y < apart * apart).any(axis=0) & (self.discs[:, 3] != CROWN)
        if (meets & ~(self._is_soft & item.on_seat)).any():
            return
        self.items.append(item)
        crown = [[item.x_m, item.y_m, item.crown_m, CROWN]] if item.crown_m > 0 else np.zeros((0, 4))
        self.discs = np.concatenate([self.discs, own, crown])
        self._is_soft = np.append(self._is_soft, np.full(len(self.discs) - len(self._is_soft), item.model is None))

    def piece(self, kind: str, x: float, y: float, turn: float = IN, *, bulky: bool = False, **sizes: float) -> None:
        """Add furniture that stands at a point."""
        layers = GROUND | UNPAVED | (BULKY if bulky else 0)
        self.add(Item(kind, None, x, y, turn, KINDS[kind].ground_m, layers, sizes=sizes))

    def line(self, kind: str, x: float, y: float, length_m: float, turn: float = ALONG, **sizes: float) -> None:
        """Add furniture along a line of a length with its middle at a point."""
        across = sizes.get("thickness_m", KINDS[kind].ground_m[1])
        size = (length_m, max(across, 0.3))
        self.add(Item(kind, None, x, y, turn, size, GROUND | UNPAVED | BULKY, sizes=sizes))

    def tree(self, x: float, y: float, stem_m: tuple[float, float], crown_m: tuple[float, float]) -> None:
        """Add a tree with a crown that begins low; sizes come in steps, so that trees share meshes."""
        stem, crown = (round(2 * self.rng.uniform(*ends)) / 2 for ends in (stem_m, crown_m))
        sizes = {"height_m": stem + round(2 * crown * self.rng.uniform(0.7, 1.1)) / 2, "crown_m": crown, "stem_m": stem}
        layers = GROUND | UNPAVED
        self.add(Item("tree", None, x, y, ALONG, KINDS["tree"].ground_m, layers, crown / 2 - LOW_CROWN_M, sizes))

    def person(self, x: float, y: float, turn: float) -> None:
        """Add a person who stands."""
        self._actor(self.cast.standing, x, y, turn)

    def sitter(self, x: float, y: float, turn: float) -> None:
        """Add a person who sits with the hips over a point of a seat."""
        model = self.cast.sitting.draw(self.rng)
        ahead = float(model.size_m[0]) / 2 - _HIPS_FROM_BACK_M
        x, y = x + ahead * float(exact.cos(turn)), y + ahead * float(exact.sin(turn))
        self.add(Item("", model, x, y, turn, _ground(model), GROUND, on_seat=True))

    def cycle(self, x: float, y: float, turn: float, *, on_rack: bool = False) -> None:
        """Add a bicycle or a scooter without a rider."""
        self._actor(self.cast.cycle, x, y, turn, on_seat=on_rack)

    def vehicle(self, x: float, y: float, turn: float) -> None:
        """Add a parked car or van."""
        self._actor(self.cast.vehicle, x, y, turn, BULKY)

    def _actor(self, role: Role, x: float, y: float, turn: float, more: int = 0, *, on_seat: bool = False) -> None:
        model = role.draw(self.rng)
        self.add(Item("", model, x, y, turn, _ground(model), GROUND | more, on_seat=on_seat))


def _ground(model: Model) -> tuple[float, float]:
    length, width, _ = model.size_m.tolist()
    return length, width


def _discs_of(item: Item) -> Floats:
    """Return the discs (K, 4) that cover an item on the ground: x, y, radius m, and layers."""
    along, radius = _row_of_discs(*item.size_m)
    turn = item.turn_rad + (0.0 if item.size_m[0] >= item.size_m[1] else np.pi / 2)
    discs = np.empty((len(along), 4))
    discs[:, 0] = item.x_m + along * exact.cos(turn)
    discs[:, 1] = item.y_m + along * exact.sin(turn)
    discs[:, 2], discs[:, 3] = radius, item.layers
    return discs


@lru_cache(1024)
def _row_of_discs(length_m: float, width_m: float) -> tuple[Floats, float]:
    """Return middles (K,) along the longer axis of a rectangle, and the radius, of discs that cover it."""
    longest, shortest = max(length_m, width_m), min(length_m, width_m)
    count = int(np.ceil(longest / shortest - 1e-6))
    along = ((np.arange(count) + 0.5) / count - 0.5) * longest
    return along, float(exact.hypot(shortest, longest / count)) / 2
