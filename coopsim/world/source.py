"""The interface of worlds, simulated or recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from coopsim.world.models.model import Model
from coopsim.world.snapshot import Actors, AgentBody, RoadMap, StaticPart


class WorldSource(Protocol):
    """A world, frame by frame, such as `World`.

    Attributes:
        models: shapes that actors' `model` indexes.
        static: meshes that never move.
        map: outlines for drawing.
    """

    models: tuple[Model, ...]
    static: tuple[StaticPart, ...]
    map: RoadMap

    def step(self, dt_s: float, maneuvers: Mapping[str, int] | None = None) -> None:
        """Advance by `dt_s`."""

    def actors(self) -> Actors:
        """Return all actors, in the world frame."""

    def agents(self) -> dict[str, AgentBody]:
        """Return the bodies of the agents, in order."""
