"""People on foot and on two wheels: they follow their ways, avoid each other, and wait for a gap where they cross.

Walking is the social force model (Helbing and Molnár, Phys. Rev. E 51, 1995): everybody relaxes towards a speed of
their own along their way, and is pushed away by others in front. How far aside that may bring them is limited, so that
pavements hold them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model, models_of
from coopsim.world.people.social_force import is_blocked, push_apart
from coopsim.world.places.layout import Footways
from coopsim.world.traffic.engine.fleet import BODY, Fleet

GAP_S = 4.0
"""A car that would be at the crossing within this time keeps people waiting."""

PATIENCE_S = 6.0
HURRIED_GAP_S = 2.5
"""Who has waited for `PATIENCE_S`, or is one of those who do not give way, goes into a smaller gap: cars brake."""

HURRIED_SHARE = 0.1

HELD_S = 3.0
SQUEEZE_S = 3.0
"""Who has been held up by others for `HELD_S` goes on through them for `SQUEEZE_S`, or a crowd would stand for ever."""

_CAUTION_M = 2.5  # from either end of a vehicle
_RELAXATION_S = 0.5
_BRAKING_M_S2 = 1.5  # towards where one may have to wait, and towards bends
_ARRIVED_M = 0.3
_TRIES = 20  # places to start that are drawn


class Manner(NamedTuple):
    """How a class moves.

    Attributes:
        speed_m_s: from, to.
        offset_m: how far beside the middle of a way people keep, at most.
        swerve_m: how much farther aside others may push them.
        bend_m_s: speed at the end of a way.
        clear_m: how far from the middle of any vehicle people start.
        ahead_m: how far ahead of their middle the road has to be free.
        passes: goes along close to vehicles that stand, in their lane.
    """

    speed_m_s: tuple[float, float]
    offset_m: float
    swerve_m: float
    bend_m_s: float
    clear_m: float
    ahead_m: float
    passes: bool


MANNERS: Mapping[ObjectClass, Manner] = {
    ObjectClass.PEDESTRIAN: Manner((1.0, 1.6), 0.3, 0.5, 1.6, 0.0, 0.9, passes=False),
    ObjectClass.CHILD: Manner((0.8, 1.4), 0.3, 0.5, 1.4, 0.0, 0.9, passes=False),
    ObjectClass.BICYCLE: Manner((3.5, 5.5), 0.05, 0.1, 2.0, 15.0, 2.5, passes=True),
    ObjectClass.SCOOTER: Manner((3.5, 5.5), 0.05, 0.1, 2.0, 15.0, 2.5, passes=True),
}
"""People in the world, in this order; the speeds of free walking are about those of Weidmann (ETH Zürich, 1993)."""


NO_BODIES = np.zeros(0, BODY)


class People:
    """N people of one class on their ways.

    Args:
        ways: where they go; None where nobody does.
        count: how many.
        label: their class, one of `MANNERS`.
        models: shapes to choose from.
        seed: the episode's.
        taken: (V, 2) m, where vehicles are: nobody starts on a lane right before one, if there is another place.
        others: (M,) `BODY`, who is there already: nobody starts in somebody else, if there is another place.
    """

    def __init__(
        self,
        ways: Footways | None,
        count: int,
        label: ObjectClass,
        models: Sequence[Model],
        seed: int,
        taken: Floats,
        others: NDArray[Any] = NO_BODIES,
    ) -> None:
        self._rng = rng = stream(seed, "people", label.title)
        self._ways = ways or Footways(
            np.zeros((1, 2)), np.full((1, 1), -1, dtype=np.int64), np.zeros((1, 1), dtype=bool)
        )
        self._manner = manner = MANNERS[label]
        self._from = self._to = self._then = np.zeros(count, dtype=np.int64)
        self._offset = rng.uniform(-manner.offset_m, manner.offset_m, (count, 2))
        self.position = np.full((count, 2), np.inf)
        fitting = models_of(models, label) if count else np.zeros(1, dtype=np.int64)
        longest_m = max(float(models[k].size_m[0]) for k in fitting)
        for _ in range(_TRIES):
            self._start_anew(~(self._is_clear(taken) & self._is_apart(longest_m, others)), rng)
        again = stream(seed, "room for people", label.title)  # where both is too much, apart is enough
        for _ in range(_TRIES):
            self._start_anew(~self._is_apart(longest_m, others), again)
        self.speed = rng.uniform(*manner.speed_m_s, count)
        self._hurried = rng.random(count) < HURRIED_SHARE
        a, b = self._ends()
        self.velocity = np.zeros((count, 2))
        self.yaw = np.arctan2(*(b - a).T[::-1])
        self.model = fitting[rng.integers(len(fitting), size=count)]
        self.travelled_m = np.zeros(count)
        size = np.array([model.size_m for model in models])[self.model]
        self._length, self._width = size[:, 0], size[:, 1]
        self._waited_s = np.zeros(count)
        self._held_s = np.zeros(count)  # by other people; below zero: time left to make way through them
        self._goes = ~self._crossing()

    def __len__(self) -> int:
        return len(self.position)

    @property
    def bodies(self) -> NDArray[Any]:
        """(N,) `BODY`: as cars see them."""
        bodies = np.zeros(len(self), BODY)
        bodies["x"], bodies["y"] = self.position.T
        bodies["heading"], bodies["speed"] = self.yaw, np.hypot(*self.velocity.T)
        bodies["length"], bodies["width"] = self._length, self._width
        return bodies

    def step(self, dt_s: float, fleet: Fleet, everybody: NDArray[Any]) -> None:
        """Advance everyone by `dt_s`.

        Args:
            dt_s: time step.
            fleet: the vehicles.
            everybody: (M,) `BODY`, all people, these included.
        """
        if not len(self):
            return
        a, b = self._ends()
        self._goes |= self._safe((a + b) / 2, fleet)
        way = b - self.position
        distance = np.linalg.norm(way, axis=1)
        heading = way / np.maximum(distance, 1e-9)[:, None]
        ahead = heading * self._manner.ahead_m
        waits = ~self._goes | is_blocked(self.position, ahead, fleet.rows, self._manner.passes)
        self._waited_s = np.where(waits, self._waited_s + dt_s, 0.0)
        wanted = heading * np.minimum(self.speed, self._allowed(distance))[:, None]
        push = push_apart(self.position, heading, everybody) * (self._held_s >= 0)[:, None]
        force = (wanted - self.velocity) / _RELAXATION_S + push
        velocity = self.velocity + force * dt_s
        fastest = np.minimum(1.0, self.speed / np.maximum(np.hypot(*velocity.T), 1e-9))
        moved = np.where(waits[:, None], 0.0, velocity * (fastest * dt_s)[:, None])
        before = self.position
        after = self._kept_on_way(before, before + moved, a, b)
        # Others may push somebody where they would not go themselves, say against a bus that waits for them.
        stopped = is_blocked(before, after - before, fleet.rows, self._manner.passes, foresight_s=0.0)
        stopped &= self._held_s >= 0  # who makes way through them is not pushed
        self.position = np.where(stopped[:, None], before, after)
        self.velocity = (self.position - before) / dt_s
        self.travelled_m += np.hypot(*self.velocity.T) * dt_s
        walks = np.hypot(*self.velocity.T) > 0.1
        self.yaw = np.where(walks, np.arctan2(self.velocity[:, 1], self.velocity[:, 0]), self.yaw)
        self._held_s = self._held_for(dt_s, ~walks & ~waits & ~self._queues(waits))
        self._turn_at_ends(a, b)
        self._turn_back()

    def _allowed(self, distance: Floats) -> Floats:
        """Speed that leaves time to brake for the way's end, m/s."""
        at_end = np.where(self._ways.crossing[self._to, self._then], 0.3, self._manner.bend_m_s)
        allowed: Floats = np.sqrt(at_end**2 + 2 * _BRAKING_M_S2 * distance)
        return allowed

    def _kept_on_way(self, before: Floats, after: Floats, a: Floats, b: Floats) -> Floats:
        """Nobody gets farther aside than allowed, or than they were."""
        along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1), 1e-9)[:, None]
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        aside_before, aside = ((place - a) * normal for place in (before, after))
        limit = np.maximum(self._manner.swerve_m, np.abs(aside_before.sum(axis=1)))
        excess = aside.sum(axis=1) - np.clip(aside.sum(axis=1), -limit, limit)
        kept: Floats = after - excess[:, None] * normal
        return kept

    def _queues(self, waits: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Who comes to where others of the class wait to cross."""
        queues: NDArray[np.bool_] = np.isin(self._to, self._from[waits]) & ~self._crossing()
        return queues

    def _held_for(self, dt_s: float, held: NDArray[np.bool_]) -> Floats:
        """Seconds, of those who are `held` and of those who make way."""
        held_s = np.where(held | (self._held_s < 0), self._held_s + dt_s, 0.0)
        return np.where(held_s > HELD_S, -SQUEEZE_S, held_s)

    def _turn_at_ends(self, a: Floats, b: Floats) -> None:
        # Everyone draws in every frame, arrived or not: one person's way does not shift another's.
        following = self._next(self._to, self._then, self._rng.random(len(self)))
        to_go = ((b - self.position) * (b - a)).sum(axis=1)
        arrived = (to_go <= 0) | (np.linalg.norm(b - self.position, axis=1) < _ARRIVED_M)
        self._from = np.where(arrived, self._to, self._from)
        self._to, self._then = np.where(arrived, self._then, self._to), np.where(arrived, following, self._then)
        self._goes = np.where(arrived, ~self._crossing(), self._goes)

    def _turn_back(self) -> None:
        """Who is held up on the road by a car, which may in turn be waiting for them, goes back."""
        stuck = self._goes & self._crossing() & (self._waited_s > PATIENCE_S)
        following = self._next(self._to, self._from, self._rng.random(len(self)))
        self._from, self._to = np.where(stuck, self._to, self._from), np.where(stuck, self._from, self._to)
        self._then = np.where(stuck, following, self._then)
        self._waited_s = np.where(stuck, 0.0, self._waited_s)

    def _start_anew(self, who: NDArray[np.bool_], rng: np.random.Generator) -> None:
        """Draw a place on a way that is not a crossing; everyone draws, and who is asked takes it."""
        count = len(who)
        places = np.argwhere((self._ways.neighbours >= 0) & ~self._to_neighbours())
        if not len(places):
            return
        node, branch = places[rng.integers(len(places), size=count)].T
        self._from = np.where(who, node, self._from)
        self._to = np.where(who, self._ways.neighbours[node, branch], self._to)
        self._then = np.where(who, self._next(self._from, self._to, rng.random(count)), self._then)
        a, b = self._ends()
        walked = rng.random(count)[:, None]
        self.position = np.where(who[:, None], a + walked * (b - a), self.position)

    def _to_neighbours(self) -> NDArray[np.bool_]:
        """(K, D) whether the way to a neighbour crosses a road."""
        rows = np.arange(len(self._ways.nodes))[:, None]
        crosses: NDArray[np.bool_] = self._ways.crossing[rows, self._ways.neighbours]
        return crosses

    def _is_clear(self, taken: Floats) -> NDArray[np.bool_]:
        """Who has found a place, and is not close to a vehicle on the road."""
        found: NDArray[np.bool_] = np.isfinite(self.position).all(axis=1)
        if not len(taken) or not found.any():
            return found
        gap_m = np.linalg.norm(np.where(found[:, None], self.position, 0.0)[:, None] - taken, axis=2).min(axis=1)
        clear: NDArray[np.bool_] = found & (gap_m > self._manner.clear_m)
        return clear

    def _is_apart(self, longest_m: float, others: NDArray[Any]) -> NDArray[np.bool_]:
        """Who is not in anybody else; of two of this class the second one is in the first."""
        place = np.nan_to_num(self.position, posinf=0.0)  # of who has not found any, and will look for one
        earlier = np.tri(len(self), k=-1, dtype=np.bool_)
        close = (np.linalg.norm(place[:, None] - place, axis=2) < longest_m) & earlier
        offset = place[:, None] - np.column_stack([others["x"], others["y"]])
        meets = np.linalg.norm(offset, axis=2) < (longest_m + others["length"]) / 2
        apart: NDArray[np.bool_] = ~(close.any(axis=1) | meets.any(axis=1))
        return apart

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
        direction = np.column_stack([np.cos(rows["heading"]), np.sin(rows["heading"])])
        offset = middle[:, None] - fleet.position
        distance = np.linalg.norm(offset, axis=2)
        closing = (offset * direction).sum(axis=2) * rows["speed"] / np.maximum(distance, 1e-9)
        hurried = self._hurried | (self._waited_s > PATIENCE_S)
        gap_s = np.where(hurried, HURRIED_GAP_S, GAP_S)
        caution_m = _CAUTION_M + rows["length"] / 2
        threatens = (closing > 0.5) & (distance < caution_m + closing * gap_s[:, None])
        safe: NDArray[np.bool_] = ~(threatens | (distance < caution_m)).any(axis=1)
        return safe
