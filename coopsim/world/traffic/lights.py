"""Traffic lights as vehicles and people meet them: they open and close movements and crosswalks as time goes on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.types import Mask, driving
from coopsim.world.places.road_network import Road
from coopsim.world.places.signals import GIVE_WAY, PRIORITY, RED, YELLOW, Signal, states
from coopsim.world.traffic.movements import FIRST, USUAL, YIELDS, Movements


class Lights:
    """The lights of a place at a time of the episode, at first at its start.

    Args:
        signals: signals of the place.
        roads: the place's movements.
        movements: movements over junctions as they are without lights.
        given: the movements of which a place says to which others they give way.

    Attributes:
        states: letters of each signal, now.
        movements: open and closed, with the right of way that they have now.
    """

    def __init__(
        self, signals: Sequence[Signal], roads: Sequence[Road], movements: Movements, given: Sequence[Road] = ()
    ) -> None:
        self._signals, self._always = tuple(signals), movements
        number = {road: k for k, road in enumerate(roads)}
        self._lit = np.array([number[road] for signal in signals for road in signal.roads], dtype=np.int64)
        self._given = np.array([road in given for road in roads], dtype=np.bool_)
        self._time_s = 0.0
        self.states = states(self._signals, 0.0)
        self.movements = self._now()

    def step(self, dt_s: float) -> None:
        """Let time pass."""
        self._time_s += dt_s
        before, self.states = self.states, states(self._signals, self._time_s)
        if self.states != before:
            self.movements = self._now()

    def _now(self) -> Movements:
        always, count = self._always, len(self._always.role)
        letters = [
            letter
            for signal, text in zip(self._signals, self.states, strict=True)
            for letter in text[: len(signal.roads)]
        ]
        letter = np.full(count, "-")
        letter[self._lit] = letters
        first, late, closed = letter == PRIORITY, letter == GIVE_WAY, (letter == YELLOW) | (letter == RED)
        role = np.where(first, FIRST, np.where(late, YIELDS, np.where(closed, USUAL, always.role))).astype(np.int64)
        # Who must give way at green, and to whom no place says, does so to all conflicting ones with priority.
        usual = np.isfinite(always.clear_m) & first
        yields = np.where((late & ~self._given)[:, None], usual, always.yields) & ~first[:, None] & ~closed
        light = np.select(
            [letter == YELLOW, letter == RED, letter != "-"], [driving.YELLOW, driving.RED, driving.GREEN]
        )
        clears = always.clears | (letter != "-")
        return always._replace(role=role, yields=yields, closed=closed, clears=clears, light=light)


def red_ways(signals: Sequence[Signal], states: Sequence[str], nodes: int) -> Mask:
    """Return the mask (nodes, nodes) of people's ways on which their light is not green, in both directions."""
    red = np.zeros((nodes, nodes), np.bool_)
    for signal, letters in zip(signals, states, strict=True):
        for (a, b), letter in zip(signal.crosswalks, letters[len(signal.roads) :], strict=True):
            red[a, b] = red[b, a] = letter in (YELLOW, RED)
    return red
