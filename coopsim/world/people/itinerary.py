"""Itineraries of people on a graph of ways: each from a node to the next, with the one after that drawn ahead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.places.layout import Footways

Mask = NDArray[np.bool_]


class Itinerary:
    """The ways of N people.

    Args:
        ways: the graph; None: one node without ways.
        offset: (N, 2) m, of each person from the middle of all their ways.
    """

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

        Returns:
            (N, 2) m: drawn places on these ways; None if nobody is chosen or all ways cross a road.
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

    def crosses(self) -> Mask:
        """Return the mask (N,) of people whose present way crosses a road."""
        return np.asarray(self._ways.crossing[self._from, self._to])

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
    """Return a neighbour (N,) of each `node` (N,), not `origin` (N,) unless there is no other.

    Args:
        neighbours: (M, B) of M nodes; -1: none.
        origin: (N,) nodes to avoid.
        node: (N,) nodes to go on from.
        draw: (N,) in [0, 1), which decide.
    """
    chosen = np.empty(len(node), np.int64)
    for n in range(len(node)):
        options = neighbours[node[n]]
        others = options[(options >= 0) & (options != origin[n])]
        if not len(others):
            others = options[options >= 0]
        chosen[n] = others[int(draw[n] * len(others))] if len(others) else options[0]
    return chosen
