"""The ground behind people's ways, on which buildings, yards and trees stand."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.geometry.se3 import Floats
from coopsim.world.towns.streets.kerb_sides import Round
from coopsim.world.towns.streets.plan import Plan


@dataclass(frozen=True, slots=True, eq=False)
class PrivateGround:
    """Private ground of a town.

    Attributes:
        plan: streets and junctions.
        rounds: the edges of the streets.
        borders: (N, 2) m of each, where private ground begins.
        seed: the town's.
        openness: in [0, 1].
    """

    plan: Plan
    rounds: tuple[Round, ...]
    borders: list[Floats]
    seed: int
    openness: float
