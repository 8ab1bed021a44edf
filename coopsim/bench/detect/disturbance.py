"""The disturbance of a row: noise of poses, and delay of messages."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Disturbance:
    """The disturbance of a row; None where the environment's own holds.

    Attributes:
        position_noise_m: standard deviation of x and of y of every agent's estimated pose.
        heading_noise_deg: standard deviation of its heading.
        delay_ms: of every message.
    """

    position_noise_m: float | None = None
    heading_noise_deg: float | None = None
    delay_ms: float | None = None

    @property
    def options(self) -> dict[str, float]:
        """Options of the environment that make it."""
        made: dict[str, float] = {}
        if self.position_noise_m is not None and self.heading_noise_deg is not None:
            made["position_noise_m"] = self.position_noise_m
            made["heading_noise_rad"] = math.radians(self.heading_noise_deg)
        if self.delay_ms is not None:
            made["latency_s"] = self.delay_ms / 1000
        return made

    @property
    def noise(self) -> str | None:
        """The noise as the command takes it, "0.4/0.4": m and degrees."""
        return None if self.position_noise_m is None else f"{self.position_noise_m:g}/{self.heading_noise_deg:g}"
