"""Compositions on free ground: each stands at the first place, of those that it is tried at, where all of it fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import numbered
from coopsim.types import Ints, Mask
from coopsim.world.furniture.free_ground import CROWN, GROUND, Candidates, Discs, Obstacles, are_free, settle
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.places.description import MapFurniture
from coopsim.world.places.layout import Bystander
from coopsim.world.surroundings.draft import LOW_CROWN_M, Draft, Item

_GAP_M = 0.3
"""Between two compositions."""


class Anchor(NamedTuple):
    """Point (2,) m on a line, the direction (rad) of the line, and its side that is outward, 1: left, -1: right."""

    at_m: Floats
    heading_rad: float
    side: int = -1


@dataclass(slots=True, eq=False)
class Stage:
    """Ground around obstacles, and what compositions have put on it so far.

    Attributes:
        obstacles: outlines that stay free.
        lanes: the lanes, over which no low crown hangs.
        furniture: pieces.
        bystanders: people and vehicles at rest.
    """

    obstacles: Obstacles
    lanes: Obstacles
    furniture: list[MapFurniture] = field(default_factory=list)
    bystanders: list[Bystander] = field(default_factory=list)
    _standing: Discs = field(default_factory=lambda: Discs(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64)))

    def put(self, drafts: Sequence[Draft], anchors: Sequence[Anchor], steps_m: Sequence[float]) -> None:
        """Put up a composition at each anchor, at the first of some distances outward where all of it fits, if any."""
        if not drafts:
            return
        steps = len(steps_m)
        counts = np.array([len(draft.discs) for draft in drafts])
        first = np.cumsum(counts) - counts
        each, place = numbered(np.repeat(counts, steps))  # alternatives of one composition follow each other
        own, step = each // steps, np.array(steps_m)[each % steps]
        discs = np.concatenate([draft.discs for draft in drafts])[first[own] + place]
        at = np.array([anchor.at_m for anchor in anchors])[own]
        heading, side = np.array([(anchor.heading_rad, anchor.side) for anchor in anchors]).T
        middles = _placed(discs[:, :2], at, exact.cos(heading)[own], exact.sin(heading)[own], side[own], step)
        layers = discs[:, 3].astype(np.int64)
        # Crowns over lanes are moved out of the grid of obstacles, where nothing fits.
        middles[self._over_lanes(middles, discs[:, 2], layers), 0] = np.inf
        candidates = Candidates(
            Discs(middles, discs[:, 2].copy(), layers),
            np.append(0, np.cumsum(np.repeat(counts, steps))),
            np.repeat(np.arange(len(drafts)), steps),
            np.full(len(drafts) * steps, -1),
        )
        fits, self._standing = settle(candidates, self.obstacles, self._standing, _GAP_M)
        for k in np.flatnonzero(fits).tolist():
            self._build(drafts[k // steps].items, anchors[k // steps], steps_m[k % steps])

    def plant(self, spots: Sequence[tuple[float, float]], sizes_m: Mapping[str, Any]) -> None:
        """Plant trees of one size at places (m) that are known to be free but for what their crowns may not touch."""
        at, radius = np.array(spots, dtype=np.float64).reshape(-1, 2), sizes_m["crown_m"] / 2 - LOW_CROWN_M
        free = are_free(at, radius, CROWN, self.obstacles) & are_free(at, radius, GROUND, self.lanes)
        self.furniture += [MapFurniture("tree", (x, y), 0.0, **sizes_m) for x, y in at[free].tolist()]

    def _over_lanes(self, middles: Floats, radii: Floats, layers: Ints) -> Mask:
        """Return the mask (N,) of crowns over a lane."""
        over: Mask = np.zeros(len(radii), np.bool_)
        crowns = layers == CROWN
        for radius in np.unique(radii[crowns]):  # sizes come in steps
            same = np.flatnonzero(crowns & (radii == radius))
            over[same] = ~are_free(middles[same], radius, GROUND, self.lanes)
        return over

    def _build(self, items: Sequence[Item], anchor: Anchor, step_m: float) -> None:
        """Add furniture and bystanders of a composition."""
        own = np.array([[item.x_m, item.y_m] for item in items]).reshape(-1, 2)
        cos, sin = exact.cos(anchor.heading_rad), exact.sin(anchor.heading_rad)
        for item, (x, y) in zip(items, _placed(own, anchor.at_m, cos, sin, anchor.side, step_m).tolist(), strict=True):
            heading = anchor.heading_rad + anchor.side * item.turn_rad
            if item.model is not None:
                self.bystanders.append(Bystander.of(item.model, x, y, heading))
            elif KINDS[item.kind].along:
                half = item.size_m[0] / 2
                dx, dy = half * float(exact.cos(heading)), half * float(exact.sin(heading))
                ends = ((x - dx, y - dy), (x + dx, y + dy))
                self.furniture.append(MapFurniture(item.kind, along=ends, **item.sizes))
            else:
                self.furniture.append(MapFurniture(item.kind, (x, y), float(np.degrees(heading)), **item.sizes))


def _placed(
    points: Floats, at_m: Floats, cos: Floats, sin: Floats, side: Floats | int, step_m: Floats | float
) -> Floats:
    """Return points (N, 2) of compositions' axes in the world's; outward is a side of the direction, see `Anchor`."""
    along_m, left_m = points[:, 0], side * (points[:, 1] + step_m)
    placed: Floats = at_m + np.column_stack([along_m * cos - left_m * sin, along_m * sin + left_m * cos])
    return placed
