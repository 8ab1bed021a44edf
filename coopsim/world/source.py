"""What a simulation needs of a world, whether it happens now or was recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from coopsim.world.models.model import Model
from coopsim.world.snapshot import Actors, AgentBody, RoadMap, StaticPart


class WorldSource(Protocol):
    """A world, frame by frame; `World` is one.

    Attributes:
        models: shapes that actors' `model` counts into.
        static: what never moves.
        map: outlines for drawing.
    """

    models: tuple[Model, ...]
    static: tuple[StaticPart, ...]
    map: RoadMap

    def step(self, dt_s: float, maneuvers: Mapping[str, int] | None = None) -> None:
        """Advance by `dt_s`."""

    def actors(self) -> Actors:
        """Everybody, in the world frame."""

    def agents(self) -> dict[str, AgentBody]:
        """Bodies of the connected agents, in order."""
