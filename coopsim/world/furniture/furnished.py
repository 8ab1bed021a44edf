"""Furnished places: layouts with street furniture and plants."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from coopsim.world.furniture.densities import YARD_STEM_M
from coopsim.world.furniture.furnish import furnish
from coopsim.world.furniture.furnishing import FurnitureEntry, furnishing_parts
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.furniture.lane_paint import lane_paint
from coopsim.world.places.layout import Layout

_STEM = 0.3  # share of a tree's height without leaves, of trees that stand by themselves


def with_furniture(layout: Layout, entries: Sequence[FurnitureEntry]) -> Layout:
    """Return a layout with furniture and painted lines, on its own ground, instead of what it had."""
    heights = None if layout.relief is None else layout.relief.heights
    return replace(layout, furnishing=(*lane_paint(layout), *furnishing_parts(entries, heights)))


def furnished(layout: Layout, description: Mapping[str, Any], seed: int) -> tuple[Layout, dict[str, Any]]:
    """Furnish a described place, besides the furniture that it has.

    Args:
        layout: as read from the description.
        description: of the place.
        seed: decides what stands where.

    Returns:
        The layout and the description, from which the same layout can be read.
    """
    entries = [*description.get("furniture", ()), *furnish(layout, seed)]
    return with_furniture(layout, entries), {**description, "furniture": entries}


def furnished_for(identity: str, layout: Layout) -> Layout:
    """Return a layout with furniture that is the same for one identity: a name, or all of a description as text."""
    return with_furniture(layout, furnish(layout, zlib.crc32(identity.encode())))


def leafy(description: Mapping[str, Any]) -> dict[str, Any]:
    """Return a description whose plain trees, of the key `trees`, are furniture, through which some rays pass."""
    trees = [_leafy(tree, number) for number, tree in enumerate(description.get("trees", ()))]
    rest = {key: value for key, value in description.items() if key != "trees"}
    return {**rest, "furniture": [*rest.get("furniture", ()), *trees]} if trees else rest


def _leafy(tree: Mapping[str, Any], number: int) -> dict[str, Any]:
    sizes = {name: round(2 * float(tree[name])) / 2 for name in ("height_m", "crown_m") if name in tree}
    height_m = sizes.get("height_m", KINDS["tree"].sizes["height_m"].usual)
    stem_m = round(min(max(_STEM * height_m, 0.5), YARD_STEM_M), 1)
    # Trees have no front: their branches lead in all directions.
    return {"kind": "tree", "at": list(tree["at"]), "heading_deg": 77.0 * number % 360.0, **sizes, "stem_m": stem_m}
