"""The pace of an episode: how far its frames are apart, and which of them are measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coopsim.support.checks import require_count
from coopsim.types import NS_PER_S, seconds_to_ns


@dataclass(frozen=True, slots=True)
class Pace:
    """The frames of an episode that are measured.

    Attributes:
        frames: their number.
        every: each so many of the environment's frames is one.
        warm_up: frames before the first, until messages have arrived.
    """

    frames: int
    every: int = 1
    warm_up: int = 1

    def __post_init__(self) -> None:
        require_count(1, frames=self.frames, every=self.every)
        require_count(0, warm_up=self.warm_up)

    @property
    def cycles(self) -> int:
        """Frames of the environment altogether."""
        return self.warm_up + (self.frames - 1) * self.every + 1

    def measures(self, frame: int) -> bool:
        """Return whether the environment's frame of this number is measured."""
        return frame >= self.warm_up and (frame - self.warm_up) % self.every == 0


def pace_of(frames: int, every_s: float, delay_s: float, fixed_s: float | None = None) -> tuple[float, Pace]:
    """Choose the time between an environment's frames, s, and which of them are measured.

    The delay is a whole number of frames, so that messages are as old as it says. Before the first measured frame a
    message has gone there and its answer has come back: some methods send what others ask for.

    Args:
        frames: measured ones.
        every_s: least time between them.
        delay_s: of messages.
        fixed_s: the time between frames, where it is given.
    """
    if fixed_s is not None:
        step_ns = seconds_to_ns(fixed_s)
    elif delay_s:
        delay_ns = seconds_to_ns(delay_s)
        step_ns = -(-delay_ns // math.ceil(delay_s / every_s - 1e-9))
    else:
        step_ns = seconds_to_ns(every_s)
    step_s = step_ns / NS_PER_S
    ticks = math.ceil(delay_s / step_s - 1e-6)
    return step_s, Pace(frames, max(1, math.ceil(every_s / step_s - 1e-6)), 1 + 2 * ticks)
