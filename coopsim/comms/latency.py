"""How long a message is on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.checks import require_non_negative
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
        require_non_negative(latency_s=self.mean_s, latency_jitter_s=self.jitter_s)

    def draw_ns(self, rng: np.random.Generator) -> int:
        """One message's delay, ns. Takes one normal from `rng`, whatever the parameters."""
        return seconds_to_ns(max(0.0, self.mean_s + self.jitter_s * float(rng.standard_normal())))
