"""Paved ground and lawns of a file, besides lanes and people's ways.

They are drawn over each other in the order of `PAVINGS`: an outline may reach below a later kind's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from coopsim.config.checked_entry import Entry
from coopsim.geometry.se3 import Floats
from coopsim.world.custom.convex import read_convex
from coopsim.world.places.layout import flat_part
from coopsim.world.snapshot import StaticPart


@dataclass(frozen=True, slots=True)
class Paving:
    """A kind of surface.

    Attributes:
        field: of `RoadMap` that its outlines belong to.
        z_m: its height.
        color: of it.
        reflectivity: at 905 nm, in [0, 1].
    """

    field: str
    z_m: float
    color: tuple[int, int, int]
    reflectivity: float


PAVINGS: Mapping[str, Paving] = {
    "grass": Paving("grass", -0.03, (86, 116, 66), 0.45),
    "yard": Paving("yards", -0.02, (134, 126, 114), 0.3),
    "parking": Paving("parking", -0.005, (88, 88, 90), 0.22),
}
"""Surfaces with a mesh of their own, from the lowest to the highest. Grass is bright to infrared light; the rest are
slabs and old asphalt."""

PAVEMENT = "pavement"
"""The kind that is raised with `kerb_m`."""

KINDS = {"road": "lanes", PAVEMENT: "pavements"} | {name: paving.field for name, paving in PAVINGS.items()}
"""Fields of `RoadMap` by the kinds that files accept."""


def read_paved(entries: Iterable[Entry]) -> dict[str, list[Floats]]:
    """Return convex outlines (K, 2) m, counter-clockwise, by the field of `RoadMap` that they belong to."""
    found: dict[str, list[Floats]] = {field: [] for field in KINDS.values()}
    for entry in entries:
        fields = entry.fields(("outline", "kind"))
        found[KINDS[fields["kind"].choice(KINDS)]].append(read_convex(fields["outline"]))
    return found


def paved_parts(paved: Mapping[str, list[Floats]]) -> list[StaticPart]:
    """Build the surfaces that are neither road nor pavement, from outlines as `read_paved` returns."""
    return [
        flat_part(name, paved[paving.field], paving.z_m, paving.color, paving.reflectivity)
        for name, paving in PAVINGS.items()
        if paved[paving.field]
    ]
