"""How long a message is on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.types import seconds_to_ns


@dataclass(frozen=True, slots=True)
class GaussianLatency:
    """A fixed delay with Gaussian jitter, cut off at zero; any value, not only multiples of a frame.

    Attributes:
        mean_s: the delay.
        jitter_s: its standard deviation; 0 makes it fixed.
    """

    mean_s: float = 0.0
    jitter_s: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("latency_s", self.mean_s), ("latency_jitter_s", self.jitter_s)):
            if not (np.isfinite(value) and value >= 0):
                raise InvalidValueError(f"{name} must be a finite number of seconds >= 0, got {value!r}")

    def draw_ns(self, rng: np.random.Generator) -> int:
        """One message's delay, ns. Takes one normal from `rng`, whatever the parameters."""
        return seconds_to_ns(max(0.0, self.mean_s + self.jitter_s * float(rng.standard_normal())))
