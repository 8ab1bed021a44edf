"""Traffic lights of a place: programs of fixed times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from coopsim.world.places.road_network import Road

PRIORITY, GIVE_WAY, YELLOW, RED = LETTERS = "Ggyr"
"""States of a light: green with priority, green but give way, yellow, red."""

SHORTEST_S = 1.0
"""Least length of a phase."""


@dataclass(frozen=True, slots=True)
class Signal:
    """Traffic lights with one program, such as those of a junction.

    Attributes:
        roads: movements over the junction, whose stop lines are at their starts.
        crosswalks: nodes of people's ways over roads.
        phases: seconds, and a letter of `LETTERS` for each of the roads, then for each of the crosswalks.
        offset_s: the program begins this much after the episode, and goes on before it, too.
    """

    roads: tuple[Road, ...]
    crosswalks: tuple[tuple[int, int], ...]
    phases: tuple[tuple[float, str], ...]
    offset_s: float = 0.0

    @property
    def cycle_s(self) -> float:
        """The length of the program."""
        return sum(seconds for seconds, _ in self.phases)

    def state(self, time_s: float) -> str:
        """Return the letters at a time of the episode."""
        left_s = (time_s - self.offset_s) % self.cycle_s
        for seconds, letters in self.phases:
            left_s -= seconds
            if left_s < -_ROUNDING_S:
                return letters
        return self.phases[0][1]


_ROUNDING_S = 1e-6  # times are sums of steps


def states(signals: Sequence[Signal], time_s: float) -> tuple[str, ...]:
    """Return the letters of all signals at a time of the episode."""
    return tuple(signal.state(time_s) for signal in signals)
