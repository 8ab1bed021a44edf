"""People on foot: they walk the pavements, wait at crosswalks for a gap, and cross."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from highway_env.road.road import Road
from highway_env.vehicle.objects import RoadObject
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.rng import stream
from coopsim.types import Ints
from coopsim.world.layout import Footways

GAP_S = 4.0
"""A car that would be at the crosswalk within this time keeps people waiting."""

PATIENCE_S = 6.0
HURRIED_GAP_S = 2.5
"""Who has waited for `PATIENCE_S` goes into a smaller gap: cars brake for people on the road."""

_CAUTION_M = 5.0
_OFFSET_M = 0.6


class _Body(RoadObject):  # type: ignore[misc]
    """A person as cars see one: an obstacle that moves. A car that touches it is crashed."""

    LENGTH = 0.6
    WIDTH = 0.6

    def __init__(self, road: Road, position: Floats) -> None:
        super().__init__(road, position)
        self.solid = True


class Pedestrians:
    """N people on footways.

    Args:
        footways: where they walk; None where nobody does.
        count: how many.
        models: indices of the models to choose from.
        road: the road on which cars see them.
        seed: the episode's.
    """

    def __init__(self, footways: Footways | None, count: int, models: Sequence[int], road: Road, seed: int) -> None:
        self._rng = rng = stream(seed, "pedestrians")
        self._ways = footways or Footways(
            np.zeros((1, 2)), np.full((1, 1), -1, dtype=np.int64), np.zeros((1, 1), dtype=bool)
        )
        self._from = rng.integers(len(self._ways.nodes), size=count)
        self._to = self._next(np.full(count, -1), self._from, rng.random(count))
        walked = rng.random(count)[:, None] * ~self._crossing()[:, None]
        self.speed = rng.uniform(1.0, 1.6, count)
        self._offset = rng.uniform(-_OFFSET_M, _OFFSET_M, (count, 2))
        a, b = self._ends()
        self.position = a + walked * (b - a)
        self.velocity = np.zeros((count, 2))
        self.yaw = np.arctan2(*(b - a).T[::-1])
        self.model = np.asarray(models, dtype=np.int64)[rng.integers(max(len(models), 1), size=count)]
        self.travelled_m = np.zeros(count)
        self._waited_s = np.zeros(count)
        self._road = road
        self._bodies = [_Body(road, position) for position in self.position]
        road.objects.extend(self._bodies)

    def __len__(self) -> int:
        return len(self.position)

    def step(self, dt_s: float) -> None:
        """Advance everyone by `dt_s`."""
        a, b = self._ends()
        at_start = np.linalg.norm(self.position - a, axis=1) < 0.05
        waits = self._crossing() & at_start & ~self._safe((a + b) / 2)
        self._waited_s = np.where(waits, self._waited_s + dt_s, 0.0)
        way = b - self.position
        distance = np.linalg.norm(way, axis=1)
        heading = way / np.maximum(distance, 1e-9)[:, None]
        stride = np.where(waits, 0.0, np.minimum(self.speed * dt_s, distance))
        self.velocity = heading * (stride / dt_s)[:, None]
        self.position = self.position + heading * stride[:, None]
        self.travelled_m += stride
        turned = distance > 1e-6
        self.yaw = np.where(turned, np.arctan2(heading[:, 1], heading[:, 0]), self.yaw)
        self._turn_at_ends(np.linalg.norm(b - self.position, axis=1) < 1e-6)
        for body, position, velocity in zip(self._bodies, self.position, self.velocity, strict=True):
            body.position, body.speed = position, float(np.hypot(*velocity))
            body.heading = float(np.arctan2(velocity[1], velocity[0]))

    def _turn_at_ends(self, arrived: NDArray[np.bool_]) -> None:
        # Everyone draws in every frame, arrived or not: one person's way does not shift another's.
        following = self._next(self._from, self._to, self._rng.random(len(self)))
        self._from, self._to = (
            np.where(arrived, self._to, self._from),
            np.where(arrived, following, self._to),
        )

    def _next(self, origin: Ints, node: Ints, draw: Floats) -> Ints:
        """A neighbour of `node`, not back to `origin` unless there is no other way."""
        options = self._ways.neighbours[node]
        allowed = (options >= 0) & (options != origin[:, None])
        allowed |= (options >= 0) & ~allowed.any(axis=1, keepdims=True)
        pick = (draw * allowed.sum(axis=1)).astype(np.int64)
        place = np.argmax(np.cumsum(allowed, axis=1) > pick[:, None], axis=1)
        chosen: Ints = options[np.arange(len(node)), place]
        return chosen

    def _ends(self) -> tuple[Floats, Floats]:
        nodes = self._ways.nodes
        return nodes[self._from] + self._offset, nodes[self._to] + self._offset

    def _crossing(self) -> NDArray[np.bool_]:
        crossing: NDArray[np.bool_] = self._ways.crossing[self._from, self._to]
        return crossing

    def _safe(self, middle: Floats) -> NDArray[np.bool_]:
        """Whether no car is about to be at `middle` (N, 2)."""
        cars: list[Any] = self._road.vehicles
        if not cars or not len(self):
            return np.ones(len(self), dtype=bool)
        position, velocity = (np.array([getattr(car, name) for car in cars]) for name in ("position", "velocity"))
        offset = middle[:, None] - position
        distance = np.linalg.norm(offset, axis=2)
        closing = (offset * velocity).sum(axis=2) / np.maximum(distance, 1e-9)
        gap_s = np.where(self._waited_s > PATIENCE_S, HURRIED_GAP_S, GAP_S)
        threatens = (closing > 0.5) & (distance < _CAUTION_M + closing * gap_s[:, None])
        safe: NDArray[np.bool_] = ~(threatens | (distance < _CAUTION_M)).any(axis=1)
        return safe
