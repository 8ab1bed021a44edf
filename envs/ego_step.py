"""The step of an ego that a picture shows, in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coopsim.types.driving import CarState, Command
from coopsim.types.messages import MANEUVERS


@dataclass(frozen=True, slots=True, eq=False)
class EgoStep:
    """Frame of an ego, and what the ego did in it.

    Attributes:
        ego: name of the ego.
        car: state of its car in the frame; None: it drives none.
        command: its command in the frame; None: there was none, or not yet.
        reward: reward for the step from the frame; None: it was not taken yet.
    """

    ego: str
    car: CarState | None
    command: Command | None = None
    reward: float | None = None

    @property
    def lines(self) -> list[str]:
        """Lines of a caption: name and speed, command, reward, as far as they are known."""
        lines = [self.ego]
        if self.car is not None:
            crashed = ", crashed" if self.car.crashed else ""
            lines[0] += f": {self.car.speed_m_s:.1f} m/s ({3.6 * self.car.speed_m_s:.0f} km/h){crashed}"
        if self.command is not None:
            if isinstance(self.command, tuple):
                lines.append(f"action {self.command[0]:+.1f} m/s², {math.degrees(self.command[1]):+.0f} degrees")
            else:
                maneuver = isinstance(self.command, int)
                lines.append(f"action {MANEUVERS[int(self.command)] if maneuver else f'{self.command:+.1f} m/s²'}")
        if self.reward is not None:
            lines.append(f"reward {self.reward:+.3f}")
        return lines
