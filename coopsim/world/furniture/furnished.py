"""Furnished places: layouts with street furniture and plants."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from coopsim.world.furniture.furnish import furnish
from coopsim.world.furniture.furnishing import FurnitureEntry, furnishing_parts
from coopsim.world.places.layout import Layout


def with_furniture(layout: Layout, entries: Sequence[FurnitureEntry]) -> Layout:
    """Return a layout with furniture, on its own ground, instead of what it had."""
    heights = None if layout.relief is None else layout.relief.heights
    return replace(layout, furnishing=furnishing_parts(entries, heights))


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


def furnished_for(name: str, layout: Layout) -> Layout:
    """Return a layout with furniture that is the same for all places of one name."""
    return with_furniture(layout, furnish(layout, zlib.crc32(name.encode())))
