"""How long a message is on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.checks import require_between, require_non_negative
from coopsim.types import seconds_to_ns

MOST_S = 3600.0
"""The longest delay; what is longer than any episode is a slip, and might not fit the clock."""


@dataclass(frozen=True, slots=True)
class GaussianLatency:
    """A fixed delay with Gaussian jitter, cut off at zero; any value, not only multiples of a frame.

    Attributes:
        mean_s: the delay, at most `MOST_S`.
        jitter_s: its standard deviation, at most `MOST_S`; 0 makes it fixed.
    """

    mean_s: float = 0.0
    jitter_s: float = 0.0

    def __post_init__(self) -> None:
        delays = {"latency_s": self.mean_s, "latency_jitter_s": self.jitter_s}
        require_non_negative(**delays)
        require_between(0, MOST_S, **delays)

    def draw_ns(self, rng: np.random.Generator) -> int:
        """One message's delay, ns. Takes one normal from `rng`, whatever the parameters."""
        return seconds_to_ns(max(0.0, self.mean_s + self.jitter_s * float(rng.standard_normal())))
