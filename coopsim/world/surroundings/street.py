"""A street around a furnished layout: compositions beside its ways, at its kerbs and walls, and parked vehicles."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.furniture.free_ground import lanes_of, obstacles_of
from coopsim.world.furniture.furnish import area_of, furnishing_parts
from coopsim.world.furniture.sides import Sides, fronts, street_sides, way_sides
from coopsim.world.places.layout import Layout
from coopsim.world.scenario import MOST_BYSTANDERS
from coopsim.world.surroundings.cast import Cast, make_cast
from coopsim.world.surroundings.compositions import AT_KERBS, AT_WALLS, BEHIND_WAYS, Composition
from coopsim.world.surroundings.draft import ALONG, BACK, Draft
from coopsim.world.surroundings.parking import driveways, in_bays
from coopsim.world.surroundings.stage import Anchor, Stage

_BEHIND_EVERY_M, _KERB_EVERY_M, _WALL_EVERY_M = 8.0, 7.0, 9.0
_BEHIND_STEPS_M, _KERB_STEPS_M, _WALL_STEPS_M = (1.2, 1.7, 2.2, 3.2, 4.2), (0.5, 2.8, 3.2), (0.0, 0.3)
"""Distances outward that compositions are tried at; at kerbs also behind a strip of parked vehicles."""

_KEPT = 4  # streets: an environment asks for the same one again when only traffic is drawn anew

_DRIVEWAYS_USED = 0.75
_SMALL_TREE_M = {"height_m": 4.5, "crown_m": 3.0, "stem_m": 1.8}


@lru_cache(_KEPT)
def as_street(layout: Layout, seed: int, *, park: bool) -> Layout:
    """Return a layout with the surroundings of a real street.

    Nothing stands where vehicles drive or people walk, in furniture or in a building. No low crown hangs over a lane.

    Args:
        layout: a place with its furniture.
        seed: decides with the layout what is there.
        park: fill the bays, too; for worlds that park nothing themselves.
    """
    area, cast = area_of(layout), make_cast()
    lanes = lanes_of(layout, area)
    # Crowns may grow into those that are there.
    bare = [part for part in layout.furnishing if part.name != "tree" or part.opacity == 1]
    stage = Stage(obstacles_of(replace(layout, furnishing=tuple(bare)), area), lanes)
    if park:
        parked, trees = in_bays(layout.bays, cast, stream(seed, "surroundings", "bays"))
        stage.bystanders += parked
        stage.plant(trees, _SMALL_TREE_M)
    _fill_driveways(stage, layout, cast, stream(seed, "surroundings", "driveways"))
    kerbs, backs = street_sides(layout, area, lanes), way_sides(layout, lanes)
    for zone, compositions, steps_m, anchors in (
        ("kerbs", AT_KERBS, _KERB_STEPS_M, _along(kerbs, _KERB_EVERY_M)),
        ("walls", AT_WALLS, _WALL_STEPS_M, _along_fronts(*fronts(layout))),
        ("behind ways", BEHIND_WAYS, _BEHIND_STEPS_M, _along(backs, _BEHIND_EVERY_M)),
    ):
        drafts = _compose(compositions, len(anchors), cast, stream(seed, "surroundings", zone))
        stage.put(drafts, anchors, steps_m)
    heights = None if layout.relief is None else layout.relief.heights
    pieces = furnishing_parts(stage.furniture, heights)
    return replace(
        layout, furnishing=(*layout.furnishing, *pieces), bystanders=tuple(stage.bystanders[:MOST_BYSTANDERS])
    )


def street_for(identity: str, layout: Layout, *, park: bool) -> Layout:
    """Return `as_street` by the identity of a place: its name, or all of its description as text."""
    return as_street(layout, zlib.crc32(identity.encode()), park=park)


def _compose(
    compositions: Sequence[tuple[Composition, float]], count: int, cast: Cast, rng: np.random.Generator
) -> list[Draft]:
    """Draw compositions, each as often as its weight says."""
    weights = np.array([weight for _, weight in compositions])
    chosen = np.searchsorted(np.cumsum(weights / weights.sum())[:-1], rng.random(count), side="right")
    drafts = [Draft(rng, cast) for _ in range(count)]
    for draft, k in zip(drafts, chosen.tolist(), strict=True):
        compositions[k][0](draft)
    return drafts


def _along(sides: Sides, every_m: float) -> list[Anchor]:
    """Return evenly spaced anchors on the edges of sides."""
    along, _ = sides.grid(every_m)
    edge, _, heading = sides.stands(along)
    return [Anchor(*each) for each in zip(edge, heading.tolist(), strict=True)]


def _along_fronts(ends: Floats, out: Floats) -> list[Anchor]:
    """Return evenly spaced anchors along fronts of buildings, of ends (N, 2, 2) m and outward unit vectors (N, 2)."""
    anchors = list[Anchor]()
    for (start, end), (x, y) in zip(ends, out.tolist(), strict=True):
        length = float(exact.hypot(*(end - start)))
        heading = float(exact.arctan2(x, -y))  # of the line whose right side is outward
        for share in (np.arange(int(length // _WALL_EVERY_M)) + 0.5) * _WALL_EVERY_M / length:
            anchors.append(Anchor(start + share * (end - start), heading))
    return anchors


def _fill_driveways(stage: Stage, layout: Layout, cast: Cast, rng: np.random.Generator) -> None:
    """Park cars on private ground; half of them face the road."""
    anchors = [Anchor(*spot) for spot in driveways(layout.road_map.yards) if rng.random() < _DRIVEWAYS_USED]
    drafts = [Draft(rng, cast) for _ in anchors]
    for draft in drafts:
        draft.vehicle(0.0, 0.0, (ALONG if rng.random() < 0.5 else BACK) + rng.normal(0.0, 0.03))
    stage.put(drafts, anchors, (0.0,))
