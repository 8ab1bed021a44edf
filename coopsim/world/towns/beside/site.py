"""What is built in a town so far, as keys of its description, and the ground that it takes up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.towns.beside.building_shapes import Part
from coopsim.world.towns.beside.room import Room

WALL_M = 0.25
"""Thickness of walls."""

_CAR_M = (6.45, 2.45)  # that the largest parked van takes up
_LOWEST_M = 2.4  # part of a building


@dataclass(frozen=True, slots=True)
class Frame:
    """A piece of private ground: x along its border with the street, y away from the street.

    Attributes:
        origin: (2,) m, where the piece begins.
        along: (2,) unit vector, in the direction of the lanes beside it.
        away: (2,) unit vector.
    """

    origin: Floats
    along: Floats
    away: Floats

    def place(self, points: Floats) -> Floats:
        """Return places (N, 2) m in the town."""
        places: Floats = self.origin + points[:, :1] * self.along + points[:, 1:] * self.away
        return places

    @property
    def heading_rad(self) -> float:
        """The direction away from the street."""
        return float(exact.arctan2(self.away[1], self.away[0]))


def frame_between(start: Floats, end: Floats) -> Frame:
    """Return the ground to the right of a line from `start` (2,) to `end` (2,) m."""
    along = (end - start) / max(float(exact.norm(end - start)), 1e-9)
    return Frame(start, along, np.array([along[1], -along[0]]))


@dataclass(slots=True, eq=False)
class Site:
    """A town in the making.

    Attributes:
        room: ground that is taken.
        kerbside: ground that vehicles parked at the kerb keep free, such as ways to driveways.
        items: lists of a description, by key.
    """

    room: Room = field(default_factory=Room)
    kerbside: Room = field(default_factory=Room)
    items: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    def add(self, key: str, **item: Any) -> None:
        """Add an item to a list of the description."""
        self.items.setdefault(key, []).append(item)

    def build(
        self,
        frame: Frame,
        parts: Sequence[Part],
        height_m: float,
        gap_m: float = 0.4,
        style: Mapping[str, Any] = MappingProxyType({}),
    ) -> bool:
        """Add a building if there is room for all parts of it; return whether there is.

        Args:
            frame: its ground.
            parts: outlines on that ground.
            height_m: of the highest parts.
            gap_m: to all others.
            style: further keys of its description; only parts of four corners have gables.
        """
        outlines = [frame.place(part.outline) for part in parts]
        if not self.room.try_take(outlines, gap_m):
            return False
        for outline, part in zip(outlines, parts, strict=True):
            looks = style if len(outline) == 4 else {key: value for key, value in style.items() if key != "roof"}
            up_m = round(max(_LOWEST_M, height_m * part.height), 2)
            self.add("buildings", outline=outline.tolist(), height_m=up_m, **looks)
        return True

    def wall(self, start: Floats, end: Floats, height_m: float) -> bool:
        """Add a straight wall between two points (2,) m if there is room; return whether there is."""
        along = end - start
        length_m = float(exact.norm(along))
        if length_m < 1.0 or not self.room.try_take([wall_outline(start, end)], 0.05):
            return False
        self.add("walls", along=[start.tolist(), end.tolist()], height_m=height_m, thickness_m=WALL_M)
        return True

    def park(self, at: Floats, heading_rad: float, gap_m: float = 0.3) -> bool:
        """Add a bay for a car, if there is room; return whether there is."""
        cos, sin = exact.cos(heading_rad) / 2, exact.sin(heading_rad) / 2
        along, aside = _CAR_M[0] * np.array([cos, sin]), _CAR_M[1] * np.array([-sin, cos])
        outline = at + np.array([-along - aside, along - aside, along + aside, aside - along])
        if not self.room.try_take([outline], gap_m):
            return False
        self.add("parked", at=at.tolist(), heading_deg=float(np.degrees(heading_rad)))
        return True

    def plant(self, at: Floats, height_m: float, crown_m: float) -> bool:
        """Add a tree if there is room for its crown; return whether there is."""
        angle = np.arange(8) * np.pi / 4
        crown = at + crown_m / 2 * np.column_stack([exact.cos(angle), exact.sin(angle)])
        if not self.room.try_take([crown], 0.2):
            return False
        self.add("trees", at=at.tolist(), height_m=height_m, crown_m=crown_m)
        return True

    def pave(self, outline: Floats, kind: str) -> None:
        """Add a surface on a convex outline (K, 2) m."""
        self.add("paved", outline=outline.tolist(), kind=kind)


def wall_outline(start: Floats, end: Floats) -> Floats:
    """Return the corners (4, 2) m of a wall from one point (2,) to another."""
    along = (end - start) / max(float(exact.norm(end - start)), 1e-9)
    aside = WALL_M / 2 * np.array([-along[1], along[0]])
    return np.array([start - aside, end - aside, end + aside, start + aside])
