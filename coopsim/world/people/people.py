"""People on foot and on two wheels: they follow their ways, avoid each other, and wait for a gap where they cross.

Walking is the social force model (Helbing and Molnár, Phys. Rev. E 51, 1995): each person relaxes towards a speed along
the way, and is pushed away by others in front. The push aside is limited, so that people stay on pavements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model, models_of
from coopsim.world.people.itinerary import Itinerary, Mask
from coopsim.world.people.social_force import is_blocked, push_apart
from coopsim.world.places.layout import Footways
from coopsim.world.traffic.engine.fleet import BODY, Fleet

GAP_S = 4.0
"""A car that would reach the crossing within this time keeps people waiting."""

PATIENCE_S = 6.0
HURRIED_GAP_S = 2.5
"""People who have waited for `PATIENCE_S`, and the share of those who never give way, accept a smaller gap: cars
brake."""

HURRIED_SHARE = 0.1

HELD_S = 3.0
SQUEEZE_S = 3.0
"""People held up by others for `HELD_S` go on through them for `SQUEEZE_S`; otherwise a crowd would stand for ever."""

_CAUTION_M = 2.5  # from either end of a vehicle
_RELAXATION_S = 0.5
_BRAKING_M_S2 = 1.5  # before crossings and bends
_ARRIVED_M = 0.3
_TRIES = 20  # draws of a place to start


class Manner(NamedTuple):
    """Manner of moving of a class.

    Attributes:
        speed_m_s: least and greatest speed.
        offset_m: greatest distance to the side of the middle of a way.
        swerve_m: additional distance to the side to which others may push a person.
        bend_m_s: speed at the end of a way.
        clear_m: distance from the middle of any vehicle at the start.
        ahead_m: length of free road needed ahead of a person's middle.
        passes: passes close along standing vehicles, in their lane.
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
"""Classes in the world's order; the speeds of free walking are about those of Weidmann (ETH Zürich, 1993)."""


NO_BODIES = np.zeros(0, BODY)


class People:
    """N people of one class on their ways.

    Args:
        ways: the graph; None where people cannot walk.
        count: number of people.
        label: their class, one of `MANNERS`.
        models: shapes to choose from.
        seed: the episode's.
        taken: (V, 2) m, positions of vehicles: people do not start on a lane right before one, if possible.
        others: (M,) `BODY`, people already there: starts do not overlap with them, if possible.

    Attributes:
        position: (N, 2) m.
        velocity: (N, 2) m/s.
        yaw: (N,) rad.
        model: (N,) indices into `models`.
        travelled_m: (N,) distance.
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
        self._manner = manner = MANNERS[label]
        self._itinerary = Itinerary(ways, rng.uniform(-manner.offset_m, manner.offset_m, (count, 2)))
        self.position = np.full((count, 2), np.inf)
        fitting = models_of(models, label) if count else np.zeros(1, dtype=np.int64)
        longest_m = max(float(models[k].size_m[0]) for k in fitting)
        for _ in range(_TRIES):
            self._start_anew(~(self._is_clear(taken) & self._is_apart(longest_m, others)), rng)
        second_rng = stream(seed, "room for people", label.title)  # where both conditions are too much, apart is enough
        for _ in range(_TRIES):
            self._start_anew(~self._is_apart(longest_m, others), second_rng)
        self._speed = rng.uniform(*manner.speed_m_s, count)
        self._hurried = rng.random(count) < HURRIED_SHARE
        start, end = self._itinerary.ends()
        self.velocity = np.zeros((count, 2))
        self.yaw = np.arctan2(*(end - start).T[::-1])
        self.model = fitting[rng.integers(len(fitting), size=count)]
        self.travelled_m = np.zeros(count)
        size = np.array([model.size_m for model in models])[self.model]
        self._length, self._width = size[:, 0], size[:, 1]
        self._waited_s = np.zeros(count)
        self._held_s = np.zeros(count)  # held up by others; below zero: time left to squeeze through them
        self._goes = ~self._itinerary.crosses()

    def __len__(self) -> int:
        return len(self.position)

    @property
    def bodies(self) -> NDArray[Any]:
        """Bodies (N,) `BODY`, as vehicles see them."""
        bodies = np.zeros(len(self), BODY)
        bodies["x"], bodies["y"] = self.position.T
        bodies["heading"], bodies["speed"] = self.yaw, np.hypot(*self.velocity.T)
        bodies["length"], bodies["width"] = self._length, self._width
        return bodies

    def step(self, dt_s: float, fleet: Fleet, everybody: NDArray[Any]) -> None:
        """Advance by `dt_s`.

        Args:
            dt_s: time step.
            fleet: the vehicles.
            everybody: (M,) `BODY`, all people, these included.
        """
        if not len(self):
            return
        start, end = self._itinerary.ends()
        self._goes |= self._is_safe((start + end) / 2, fleet)
        way = end - self.position
        distance = np.linalg.norm(way, axis=1)
        heading = way / np.maximum(distance, 1e-9)[:, None]
        ahead = heading * self._manner.ahead_m
        waits = ~self._goes | is_blocked(self.position, ahead, fleet.rows, self._manner.passes)
        self._waited_s = np.where(waits, self._waited_s + dt_s, 0.0)
        wanted = heading * np.minimum(self._speed, self._allowed(distance))[:, None]
        push = push_apart(self.position, heading, everybody) * (self._held_s >= 0)[:, None]
        force = (wanted - self.velocity) / _RELAXATION_S + push
        velocity = self.velocity + force * dt_s
        fastest = np.minimum(1.0, self._speed / np.maximum(np.hypot(*velocity.T), 1e-9))
        moved = np.where(waits[:, None], 0.0, velocity * (fastest * dt_s)[:, None])
        before = self.position
        after = self._kept_on_way(before, before + moved, start, end)
        # Others may push a person where they would not go themselves, such as against a bus that waits for them.
        stopped = is_blocked(before, after - before, fleet.rows, self._manner.passes, foresight_s=0.0)
        stopped &= self._held_s >= 0  # people who squeeze through are not pushed
        self.position = np.where(stopped[:, None], before, after)
        self.velocity = (self.position - before) / dt_s
        self.travelled_m += np.hypot(*self.velocity.T) * dt_s
        walks = np.hypot(*self.velocity.T) > 0.1
        self.yaw = np.where(walks, np.arctan2(self.velocity[:, 1], self.velocity[:, 0]), self.yaw)
        self._held_s = self._held_for(dt_s, ~walks & ~waits & ~self._itinerary.leads_to_waiting(waits))
        self._turn_at_ends(start, end)
        self._turn_back()

    def _allowed(self, distance: Floats) -> Floats:
        """Return the speed that leaves time to brake for the way's end, m/s."""
        at_end = np.where(self._itinerary.will_cross(), 0.3, self._manner.bend_m_s)
        return np.sqrt(at_end**2 + 2 * _BRAKING_M_S2 * distance)

    def _kept_on_way(self, before: Floats, after: Floats, start: Floats, end: Floats) -> Floats:
        """Return `after`, not farther aside than allowed, or than before."""
        along = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1), 1e-9)[:, None]
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        aside_before, aside = ((place - start) * normal for place in (before, after))
        limit = np.maximum(self._manner.swerve_m, np.abs(aside_before.sum(axis=1)))
        excess = aside.sum(axis=1) - np.clip(aside.sum(axis=1), -limit, limit)
        return np.asarray(after - excess[:, None] * normal)

    def _held_for(self, dt_s: float, held: Mask) -> Floats:
        """Return the time (N,) in seconds that people of the mask (N,) have been held up or squeeze through."""
        held_s = np.where(held | (self._held_s < 0), self._held_s + dt_s, 0.0)
        return np.where(held_s > HELD_S, -SQUEEZE_S, held_s)

    def _turn_at_ends(self, start: Floats, end: Floats) -> None:
        # Everyone draws in every frame, arrived or not, so people's ways are independent.
        draw = self._rng.random(len(self))
        to_go = ((end - self.position) * (end - start)).sum(axis=1)
        arrived = (to_go <= 0) | (np.linalg.norm(end - self.position, axis=1) < _ARRIVED_M)
        self._itinerary.go_on(arrived, draw)
        self._goes = np.where(arrived, ~self._itinerary.crosses(), self._goes)

    def _turn_back(self) -> None:
        """Send people back who are held up on the road by a car, which may in turn be waiting for them."""
        stuck = self._goes & self._itinerary.crosses() & (self._waited_s > PATIENCE_S)
        self._itinerary.turn_back(stuck, self._rng.random(len(self)))
        self._waited_s = np.where(stuck, 0.0, self._waited_s)

    def _start_anew(self, chosen: Mask, rng: np.random.Generator) -> None:
        """Draw new starts for people of the mask (N,)."""
        places = self._itinerary.start_anew(chosen, rng)
        if places is not None:
            self.position = np.where(chosen[:, None], places, self.position)

    def _is_clear(self, taken: Floats) -> Mask:
        """Return the mask (N,) of people with a start that is not close to a vehicle on the road."""
        found: Mask = np.isfinite(self.position).all(axis=1)
        if not len(taken) or not found.any():
            return found
        gap_m = np.linalg.norm(np.where(found[:, None], self.position, 0.0)[:, None] - taken, axis=2).min(axis=1)
        return np.asarray(found & (gap_m > self._manner.clear_m))

    def _is_apart(self, longest_m: float, others: NDArray[Any]) -> Mask:
        """Return the mask (N,) of people who overlap with no other; of two of this class the second one does."""
        place = np.nan_to_num(self.position, posinf=0.0)  # of people without a start yet
        earlier = np.tri(len(self), k=-1, dtype=np.bool_)
        close = (np.linalg.norm(place[:, None] - place, axis=2) < longest_m) & earlier
        offset = place[:, None] - np.column_stack([others["x"], others["y"]])
        meets = np.linalg.norm(offset, axis=2) < (longest_m + others["length"]) / 2
        return np.asarray(~(close.any(axis=1) | meets.any(axis=1)))

    def _is_safe(self, middle: Floats, fleet: Fleet) -> Mask:
        """Return the mask (N,) of places (N, 2) that no vehicle is at or about to reach."""
        rows = fleet.rows
        direction = np.column_stack([np.cos(rows["heading"]), np.sin(rows["heading"])])
        offset = middle[:, None] - fleet.position
        distance = np.linalg.norm(offset, axis=2)
        closing = (offset * direction).sum(axis=2) * rows["speed"] / np.maximum(distance, 1e-9)
        hurried = self._hurried | (self._waited_s > PATIENCE_S)
        gap_s = np.where(hurried, HURRIED_GAP_S, GAP_S)
        caution_m = _CAUTION_M + rows["length"] / 2
        threatens = (closing > 0.5) & (distance < caution_m + closing * gap_s[:, None])
        return np.asarray(~(threatens | (distance < caution_m)).any(axis=1))
