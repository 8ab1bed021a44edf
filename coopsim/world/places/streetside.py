"""Ground beside streets, on which lots are built: what draws these docks here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from coopsim.geometry.se3 import Floats
from coopsim.geometry.taken_ground import TakenGround
from coopsim.support.registry import Registry


@dataclass(frozen=True, slots=True, eq=False)
class Streetside:
    """Ground beside streets. Lines (N, 2) m have the street on their left; closed ones end where they begin.

    Attributes:
        seed: seed of what is drawn.
        kerbs: edges of pavements, along which trees may stand.
        fronts: borders of private ground, on which lots are built.
        country: borders of ground with trees alone.
        taken: ground on which nothing is built.
        kerbside: ground at kerbs where no tree stands.
    """

    seed: int
    kerbs: tuple[Floats, ...]
    fronts: tuple[Floats, ...]
    country: tuple[Floats, ...]
    taken: TakenGround
    kerbside: TakenGround


LOTS: Registry[Callable[[Streetside], Mapping[str, tuple[Any, ...]]]] = Registry(
    "builder of lots", home="coopsim.world.towns.streetside"
)
"""Functions that draw fields of a `PlaceDescription` (buildings, walls, trees, paved, parked): "town"."""
