"""Traffic lights of a place: programs of fixed times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
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


def lights_of(signals: Sequence[Signal], states: Sequence[str]) -> str:
    """Return the letters of all movements, in the order of the map's stop lines, from those of all signals."""
    return "".join(text[: len(signal.roads)] for signal, text in zip(signals, states, strict=True))


def by_line(stop_lines: Sequence[Floats]) -> list[list[int]]:
    """Return the numbers of the lights at each line: movements from one lane share theirs, turned a bit or not."""
    shared: dict[bytes, list[int]] = {}
    for number, line in enumerate(stop_lines):
        middle = np.round(1000.0 * line.mean(axis=0)).astype(np.int64)
        shared.setdefault(middle.tobytes(), []).append(number)
    return list(shared.values())


def stop_bars(stop_lines: Sequence[Floats], width_m: float) -> list[Floats]:
    """Return outlines (4, 2) m of bars before stop lines (2, 2), which lead from right to left.

    Where movements share a line, each has an equal part of it, from right to left in their order.
    """
    bars: dict[int, Floats] = {}
    for numbers in by_line(stop_lines):
        right, left = stop_lines[numbers[0]]
        across = left - right
        back = width_m / exact.norm(across) * np.array([-across[1], across[0]])
        for place, number in enumerate(numbers):
            ends = [right + share / len(numbers) * across for share in (place, place + 1)]
            bars[number] = np.array([*ends, ends[1] + back, ends[0] + back])
    return [bars[number] for number in range(len(stop_lines))]
