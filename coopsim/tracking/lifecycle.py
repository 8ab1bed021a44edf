"""When a track is worth reporting, and when it is given up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.checks import require_count
from coopsim.types import Ints

Mask = NDArray[np.bool_]


class Lifecycle(Protocol):
    """Decides for N tracks at once."""

    def reported(self, hits: Ints, misses: Ints, frame: int) -> Mask:
        """Which to report, (N,).

        Args:
            hits: (N,) detections so far.
            misses: (N,) frames since the last detection; 0 if detected in this one.
            frame: number of this frame, from 1.
        """

    def alive(self, misses: Ints) -> Mask:
        """Which to keep, (N,)."""


@dataclass(frozen=True, slots=True)
class HitsAndAge:
    """AB3DMOT's rule (Weng et al. 2020, sec. III-E): confirmed by hits, dropped by age.

    In the first `hits` frames every track is reported, because none can be confirmed yet.

    Attributes:
        hits: detections until a track is reported.
        age: frames without a detection until it is dropped; until then its prediction is reported.
    """

    hits: int = 3
    age: int = 2

    def __post_init__(self) -> None:
        require_count(1, hits=self.hits, age=self.age)

    def reported(self, hits: Ints, misses: Ints, frame: int) -> Mask:
        confirmed = (hits >= self.hits) | (frame <= self.hits)
        return confirmed & (misses < self.age)

    def alive(self, misses: Ints) -> Mask:
        return misses < self.age
