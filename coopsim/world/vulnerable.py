"""People on foot: they walk the pavements, wait at crosswalks for a gap, and cross."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.rng import stream
from coopsim.types import Ints
from coopsim.world.engine.fleet import BODY, Fleet
from coopsim.world.layout import Footways

GAP_S = 4.0
"""A car that would be at the crosswalk within this time keeps people waiting."""

PATIENCE_S = 6.0
HURRIED_GAP_S = 2.5
"""Who has waited for `PATIENCE_S` goes into a smaller gap: cars brake for people on the road."""

_CAUTION_M = 5.0
_OFFSET_M = 0.6
_BODY_M = 0.6


class Pedestrians:
    """N people on footways.

    Args:
        footways: where they walk; None where nobody does.
        count: how many.
        models: indices of the models to choose from.
        seed: the episode's.
    """

    def __init__(self, footways: Footways | None, count: int, models: Sequence[int], seed: int) -> None:
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
        self.color = rng.integers(40, 220, (count, 3)).astype(np.uint8)
        self._waited_s = np.zeros(count)

    def __len__(self) -> int:
        return len(self.position)

    @property
    def bodies(self) -> NDArray[Any]:
        """(N,) `BODY`: as cars see them."""
        bodies = np.zeros(len(self), BODY)
        bodies["x"], bodies["y"] = self.position.T
        bodies["heading"], bodies["speed"] = np.arctan2(*self.velocity.T[::-1]), np.hypot(*self.velocity.T)
        bodies["length"] = bodies["width"] = _BODY_M
        return bodies

    def step(self, dt_s: float, fleet: Fleet) -> None:
        """Advance everyone by `dt_s`, among vehicles."""
        a, b = self._ends()
        at_start = np.linalg.norm(self.position - a, axis=1) < 0.05
        waits = self._crossing() & at_start & ~self._safe((a + b) / 2, fleet)
        self._waited_s = np.where(waits, self._waited_s + dt_s, 0.0)
        way = b - self.position
        distance = np.linalg.norm(way, axis=1)
        heading = way / np.maximum(distance, 1e-9)[:, None]
        stride = np.where(waits, 0.0, np.minimum(self.speed * dt_s, distance))
        self.velocity = heading * (stride / dt_s)[:, None]
        self.position = self.position + heading * stride[:, None]
        turned = distance > 1e-6
        self.yaw = np.where(turned, np.arctan2(heading[:, 1], heading[:, 0]), self.yaw)
        self._turn_at_ends(np.linalg.norm(b - self.position, axis=1) < 1e-6)

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

    def _safe(self, middle: Floats, fleet: Fleet) -> NDArray[np.bool_]:
        """Whether no car is about to be at `middle` (N, 2)."""
        rows = fleet.rows
        if not len(rows):
            return np.ones(len(self), dtype=bool)
        direction = np.column_stack([np.cos(rows["heading"]), np.sin(rows["heading"])])
        position, velocity = fleet.position, direction * rows["speed"][:, None]
        offset = middle[:, None] - position
        distance = np.linalg.norm(offset, axis=2)
        closing = (offset * velocity).sum(axis=2) / np.maximum(distance, 1e-9)
        gap_s = np.where(self._waited_s > PATIENCE_S, HURRIED_GAP_S, GAP_S)
        threatens = (closing > 0.5) & (distance < _CAUTION_M + closing * gap_s[:, None])
        safe: NDArray[np.bool_] = ~(threatens | (distance < _CAUTION_M)).any(axis=1)
        return safe
