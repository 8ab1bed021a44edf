"""Worlds for tests, and their state frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.scenario import SCENARIOS as REGISTERED
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors
from coopsim.world.world import World

DT_S = 0.1
SCENARIOS = REGISTERED.names()


def make_world(name: str, seed: int = 0, *, control: str = "traffic", **numbers: Any) -> World:
    return World(make_scenario(name, **numbers), seed, control=control)


def frames(world: World, steps: int, maneuvers: Mapping[str, int] | None = None) -> Iterator[Actors]:
    """Yield the actors now, and after each of `steps` steps."""
    yield world.actors()
    for _ in range(steps):
        world.step(DT_S, maneuvers)
        yield world.actors()


def vehicles(actors: Actors) -> Actors:
    return actors[actors.label != ObjectClass.PEDESTRIAN]


def people(actors: Actors) -> Actors:
    return actors[actors.label == ObjectClass.PEDESTRIAN]


def table(actors: Actors) -> NDArray[np.float64]:
    """Return all attributes of the actors, a row each."""
    return np.column_stack(
        [
            actors.id,
            actors.boxes.array,
            actors.velocity,
            actors.label,
            actors.model,
            actors.color,
            actors.accent,
            actors.phase,
        ]
    ).astype(np.float64)


def place_of(world: World, agent: str) -> NDArray[np.float64]:
    """Return an agent's position, x and y, m."""
    return np.asarray(world.agents()[agent].world_SE3_base.translation[:2])


def speed_of(world: World, agent: str) -> float:
    actors = world.actors()
    (row,) = np.flatnonzero(actors.id == world.agents()[agent].actor_id)
    return float(np.hypot(*actors.velocity[row]))
