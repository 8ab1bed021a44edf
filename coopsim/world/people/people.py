"""People on foot and on two wheels: they follow their ways, avoid each other, and wait for a gap where they cross.

Walking is the social force model (Helbing and Molnár, Phys. Rev. E 51, 1995): each person relaxes towards a speed along
the way, and is pushed away by others in front. The push aside is limited, so that people stay on pavements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import draw_models, models_of
from coopsim.world.models.model import Model
from coopsim.world.people.walking import Walkers, advance, headings, is_blocked, is_safe, push_apart
from coopsim.world.places.layout import Footways
from coopsim.world.traffic.fleet import BODY, Fleet

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
        count: N.
        label: one of `MANNERS`.
        models: shapes to choose from.
        seed: seed of the episode.
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
        misplaced = np.ones(count, dtype=np.bool_)
        for _ in range(_TRIES):
            if misplaced.any():  # once nobody is, nobody moves again
                misplaced = ~(self._is_clear(taken) & self._is_apart(longest_m, others))
            self._start_anew(misplaced, rng)
        second_rng = stream(seed, "room for people", label.title)  # where both conditions are too much, apart is enough
        for _ in range(_TRIES if misplaced.any() else 0):
            self._start_anew(~self._is_apart(longest_m, others), second_rng)
        self._speed = rng.uniform(*manner.speed_m_s, count)
        self._hurried = rng.random(count) < HURRIED_SHARE
        start, end = self._itinerary.ends()
        self.velocity = np.zeros((count, 2))
        self.yaw = np.arctan2(*(end - start).T[::-1])
        self.model = draw_models(rng, models, fitting, count)
        self.travelled_m = np.zeros(count)
        size = np.array([model.size_m for model in models])[self.model]
        self._length, self._width = size[:, 0], size[:, 1]
        self._waited_s = np.zeros(count)
        self._held_s = np.zeros(count)  # held up by others; below zero: time left to squeeze through them
        self._goes = ~self._itinerary.crosses()

    def __len__(self) -> int:
        return len(self.position)

    def describe(self, bodies: NDArray[Any]) -> None:
        """Fill bodies (N,) `BODY` that are zero, as vehicles see them."""
        bodies["x"], bodies["y"] = self.position[:, 0], self.position[:, 1]
        bodies["heading"], bodies["speed"] = self.yaw, np.hypot(self.velocity[:, 0], self.velocity[:, 1])
        bodies["length"], bodies["width"] = self._length, self._width

    def step(self, dt_s: float, fleet: Fleet, everybody: NDArray[Any], red: Mask | None = None) -> None:
        """Advance by `dt_s` among vehicles and `everybody` (M,) `BODY`: all people, these included.

        Nobody begins to cross where the mask `red` (K, K) of the ways between nodes says so.
        """
        if not len(self):
            return
        start, end = self._itinerary.ends()
        safe = self._is_safe((start + end) / 2, fleet)
        self._goes |= safe if red is None else safe & ~self._itinerary.is_on(red)
        walkers = Walkers(self.position, self.velocity, start, end, self._speed, self._itinerary.will_cross())
        heading, distance = headings(walkers)
        passes, before = self._manner.passes, self.position
        waits = ~self._goes | is_blocked(before, heading * self._manner.ahead_m, fleet.rows, passes)
        self._waited_s = np.where(waits, self._waited_s + dt_s, 0.0)
        push = push_apart(before, heading, everybody) * (self._held_s >= 0)[:, None]
        after = advance(walkers, heading, distance, waits, push, self._manner.bend_m_s, self._manner.swerve_m, dt_s)
        # Others may push a person where they would not go themselves, such as against a bus that waits for them.
        stopped = is_blocked(before, after - before, fleet.rows, passes, foresight_s=0.0)
        stopped &= self._held_s >= 0  # people who squeeze through are not pushed
        self.position = np.where(stopped[:, None], before, after)
        self.velocity = (self.position - before) / dt_s
        speed = np.hypot(self.velocity[:, 0], self.velocity[:, 1])
        self.travelled_m += speed * dt_s
        walks = speed > 0.1
        self.yaw = np.where(walks, np.arctan2(self.velocity[:, 1], self.velocity[:, 0]), self.yaw)
        held = ~walks & ~waits
        if held.any():
            held &= ~self._itinerary.leads_to_waiting(waits)
        self._held_s = self._held_for(dt_s, held)
        self._turn_at_ends(start, end)
        self._turn_back()

    def _held_for(self, dt_s: float, held: Mask) -> Floats:
        """Return the time (N,) in seconds that people of the mask (N,) have been held up or squeeze through."""
        held_s = np.where(held | (self._held_s < 0), self._held_s + dt_s, 0.0)
        return np.where(held_s > HELD_S, -SQUEEZE_S, held_s)

    def _turn_at_ends(self, start: Floats, end: Floats) -> None:
        # Everyone draws in every frame, arrived or not, so people's ways are independent.
        draw = self._rng.random(len(self))
        left, way = end - self.position, end - start
        to_go = left[:, 0] * way[:, 0] + left[:, 1] * way[:, 1]
        arrived = (to_go <= 0) | (np.sqrt(left[:, 0] * left[:, 0] + left[:, 1] * left[:, 1]) < _ARRIVED_M)
        if arrived.any():
            self._itinerary.go_on(arrived, draw)
            self._goes = np.where(arrived, ~self._itinerary.crosses(), self._goes)

    def _turn_back(self) -> None:
        """Send people back who are held up on the road by a car, which may in turn be waiting for them."""
        draw = self._rng.random(len(self))
        waits_long = self._waited_s > PATIENCE_S
        if waits_long.any():
            stuck = self._goes & self._itinerary.crosses() & waits_long
            self._itinerary.turn_back(stuck, draw)
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
        hurried = self._hurried | (self._waited_s > PATIENCE_S)
        heading, direction = fleet.rows["heading"], np.empty((len(fleet.rows), 2))
        direction[:, 0], direction[:, 1] = np.cos(heading), np.sin(heading)
        return np.asarray(is_safe(middle, np.where(hurried, HURRIED_GAP_S, GAP_S), fleet.rows, direction))


class Group(Protocol):
    """People who are bodies in each other's and in vehicles' way."""

    def __len__(self) -> int: ...

    def describe(self, bodies: NDArray[Any]) -> None:
        """Fill bodies (N,) `BODY` that are zero, as vehicles see them."""


def join_bodies(groups: Sequence[Group]) -> NDArray[Any]:
    """Return the bodies (M,) `BODY` of all groups, in order."""
    # To concatenate structs would take longer than to fill them.
    bodies, end = np.zeros(sum(map(len, groups)), BODY), 0
    for people in groups:
        begin, end = end, end + len(people)
        if len(people):
            people.describe(bodies[begin:end])
    return bodies


Mask = NDArray[np.bool_]


class Itinerary:
    """The ways of N people, `offset` (N, 2) m from the middles of a graph's ways; None: one node without ways."""

    def __init__(self, ways: Footways | None, offset: Floats) -> None:
        self._ways = ways or Footways(
            np.zeros((1, 2)), np.full((1, 1), -1, dtype=np.int64), np.zeros((1, 1), dtype=bool)
        )
        self._offset = offset
        nodes = np.arange(len(self._ways.nodes))[:, None]
        quiet = (self._ways.neighbours >= 0) & ~self._ways.crossing[nodes, self._ways.neighbours]
        self._starts = np.argwhere(quiet)  # node and branch
        self._from = self._to = self._then = np.zeros(len(offset), dtype=np.int64)

    def start_anew(self, chosen: Mask, rng: np.random.Generator) -> Floats | None:
        """Move people of the mask (N,) to drawn ways that cross no road; everyone draws.

        Return drawn places (N, 2) m on these ways; None if nobody is chosen or all ways cross a road.
        """
        if not len(self._starts):
            return None
        drawn = rng.integers(len(self._starts), size=len(chosen))
        turn, walked = rng.random((2, len(chosen)))
        if not chosen.any():
            return None
        node, branch = self._starts[drawn].T
        self._from = np.where(chosen, node, self._from)
        self._to = np.where(chosen, self._ways.neighbours[node, branch], self._to)
        self._then = np.where(chosen, choose_next(self._ways.neighbours, self._from, self._to, turn), self._then)
        start, end = self.ends()
        return np.asarray(start + walked[:, None] * (end - start))

    def ends(self) -> tuple[Floats, Floats]:
        """Return the two ends (N, 2) m of each person's present way."""
        nodes = self._ways.nodes
        return nodes[self._from] + self._offset, nodes[self._to] + self._offset

    def is_on(self, ways: Mask) -> Mask:
        """Return the mask (N,) of people whose present way is one of a mask (K, K) of ways between nodes."""
        return np.asarray(ways[self._from, self._to])

    def crosses(self) -> Mask:
        """Return the mask (N,) of people whose present way crosses a road."""
        return self.is_on(self._ways.crossing)

    def will_cross(self) -> Mask:
        """Return the mask (N,) of people whose next way crosses a road."""
        return np.asarray(self._ways.crossing[self._to, self._then])

    def leads_to_waiting(self, waits: Mask) -> Mask:
        """Return the mask (N,) of people on a way (no crossing) to where others of the mask (N,) wait to cross."""
        waited_at = np.zeros(len(self._ways.nodes), np.bool_)
        waited_at[self._from[waits]] = True
        return np.asarray(waited_at[self._to] & ~self.crosses())

    def go_on(self, arrived: Mask, draw: Floats) -> None:
        """Begin the next way of people who have arrived (N,); `draw` (N,) in [0, 1) decides on the one after that."""
        following = choose_next(self._ways.neighbours, self._to, self._then, draw)
        self._from = np.where(arrived, self._to, self._from)
        self._to, self._then = np.where(arrived, self._then, self._to), np.where(arrived, following, self._then)

    def turn_back(self, chosen: Mask, draw: Floats) -> None:
        """Reverse the way of people of the mask (N,)."""
        following = choose_next(self._ways.neighbours, self._to, self._from, draw)
        self._from, self._to = np.where(chosen, self._to, self._from), np.where(chosen, self._from, self._to)
        self._then = np.where(chosen, following, self._then)


@njit(cache=True, nogil=True)
def choose_next(neighbours: Ints, origin: Ints, node: Ints, draw: Floats) -> Ints:
    """Return a neighbour (N,) of each `node` (N,), not `origin` (N,) unless there is no other, decided by `draw` (N,).

    `neighbours` is (M, B) for M nodes; -1: none.
    """
    chosen = np.empty(len(node), np.int64)
    for n in range(len(node)):
        options = neighbours[node[n]]
        others = options[(options >= 0) & (options != origin[n])]
        if not len(others):
            others = options[options >= 0]
        chosen[n] = others[int(draw[n] * len(others))] if len(others) else options[0]
    return chosen
