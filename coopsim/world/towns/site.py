"""A town under construction: parts of its description so far, and the ground that they take up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.support.rng import stream
from coopsim.world.places.description import (
    MapArea,
    MapBay,
    MapBuilding,
    MapTree,
    MapWall,
    line_of,
    point_of,
)
from coopsim.world.towns.buildings import Part
from coopsim.world.towns.kerbs import Round
from coopsim.world.towns.pavements import PeopleWays
from coopsim.world.towns.plan import Plan

_WALL_M = 0.25  # thickness
_CAR_M = (6.45, 2.45)  # size of the largest parked van
_LOWEST_M = 2.4  # height of a part of a building, at least


@dataclass(frozen=True, slots=True)
class Frame:
    """Piece of private ground from an origin (2,) m on: x `along` its border with the street, y `away` from it."""

    origin: Floats
    along: Floats
    away: Floats

    def place(self, points: Floats) -> Floats:
        """Return places (N, 2) m in the town."""
        places: Floats = self.origin + points[:, :1] * self.along + points[:, 1:] * self.away
        return places

    @property
    def heading_rad(self) -> float:
        """Direction away from the street."""
        return float(exact.arctan2(self.away[1], self.away[0]))


def frame_between(start: Floats, end: Floats) -> Frame:
    """Return the ground to the right of a line from `start` (2,) to `end` (2,) m."""
    along = (end - start) / max(float(exact.norm(end - start)), 1e-9)
    return Frame(start, along, np.array([along[1], -along[0]]))


@dataclass(slots=True, eq=False)
class Site:
    """Town under construction.

    Attributes:
        plan: streets and junctions.
        seed: seed of the town.
        openness: view past the corners, in [0, 1].
        rounds: edges of the streets.
        kerbs: lines of all kerbs, see `kerb_lines_of`.
        ways: ways of people.
        borders: (N, 2) m for each round, edges of private ground.
        taken: ground that is taken.
        kerbside: ground that vehicles parked at the kerb keep free, such as ways to driveways.
        parts: parts of the description so far, by its field.
    """

    plan: Plan
    seed: int
    openness: float
    rounds: tuple[Round, ...]
    kerbs: tuple[Floats, Floats, Floats]
    ways: PeopleWays
    borders: list[Floats]
    taken: TakenGround = field(default_factory=TakenGround)
    kerbside: TakenGround = field(default_factory=TakenGround)
    parts: dict[str, list[Any]] = field(default_factory=dict)

    def stream(self, *names: object) -> np.random.Generator:
        """Return the random numbers of a part of the town."""
        return stream(self.seed, *map(str, names))

    def add(self, name: str, part: Any) -> None:
        """Add a part to a field of the description."""
        self.parts.setdefault(name, []).append(part)

    def build(
        self,
        frame: Frame,
        parts: Sequence[Part],
        height_m: float,
        gap_m: float = 0.4,
        style: Mapping[str, Any] = MappingProxyType({}),
    ) -> bool:
        """Add a building of parts on their ground if all are `gap_m` from others; return whether they are.

        `style` has further fields of a `MapBuilding`; only parts of four corners have gables.
        """
        outlines = [frame.place(part.outline) for part in parts]
        if not self.taken.try_take(outlines, gap_m):
            return False
        for outline, part in zip(outlines, parts, strict=True):
            own = style if len(outline) == 4 else {key: value for key, value in style.items() if key != "roof"}
            up_m = round(max(_LOWEST_M, height_m * part.height), 2)
            self.add("buildings", MapBuilding(line_of(outline), up_m, **own))
        return True

    def wall(self, start: Floats, end: Floats, height_m: float) -> None:
        """Add a straight wall between two points (2,) m if there is space."""
        length_m = float(exact.norm(end - start))
        along = (end - start) / max(length_m, 1e-9)
        aside = _WALL_M / 2 * np.array([-along[1], along[0]])
        outline = np.array([start - aside, end - aside, end + aside, start + aside])
        if length_m >= 1.0 and self.taken.try_take([outline], 0.05):
            self.add("walls", MapWall((point_of(start), point_of(end)), float(height_m), _WALL_M))

    def park(self, at: Floats, heading_rad: float) -> None:
        """Add a bay for a car off the street if there is space."""
        cos, sin = exact.cos(heading_rad) / 2, exact.sin(heading_rad) / 2
        along, aside = _CAR_M[0] * np.array([cos, sin]), _CAR_M[1] * np.array([-sin, cos])
        outline = at + np.array([-along - aside, along - aside, along + aside, aside - along])
        if self.taken.try_take([outline], 0.3):
            self.add("parked", MapBay(point_of(at), float(np.degrees(heading_rad))))

    def plant(self, at: Floats, height_m: float, crown_m: float) -> None:
        """Add a tree if there is space for its crown."""
        angle = np.arange(8) * np.pi / 4
        crown = at + crown_m / 2 * np.column_stack([exact.cos(angle), exact.sin(angle)])
        if self.taken.try_take([crown], 0.2):
            self.add("trees", MapTree(point_of(at), height_m, crown_m))

    def pave(self, outline: Floats, kind: str) -> None:
        """Add a surface on a convex outline (K, 2) m."""
        self.add("paved", MapArea(line_of(outline), kind))

    def pave_if_free(self, outline: Floats, kind: str) -> bool:
        """Add a surface if its ground is not taken, without taking it; return whether it is not."""
        free = self.taken.is_free(outline)
        if free:
            self.pave(outline, kind)
        return free
