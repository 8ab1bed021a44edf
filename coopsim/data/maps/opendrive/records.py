"""Records of cubic polynomials along a road: `a + b ds + c ds^2 + d ds^3` from where each starts to the next one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from coopsim.data.maps.elements import Element, numbers
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints

_NEAR_M = 1e-6
"""Places that are as close as this are one: files round."""


@dataclass(frozen=True, slots=True, eq=False)
class Cubics:
    """Cubic polynomials.

    Attributes:
        starts: (N,) m along the road, rising.
        factors: (N, 4) a, b, c, d.
    """

    starts: Floats
    factors: Floats

    @classmethod
    def read(cls, elements: Sequence[Element], start: str = "s", from_m: float = 0.0) -> Self:
        """Read records, in whatever order they are; their attribute `start` counts from `from_m`."""
        if not elements:
            return cls(np.zeros(0), np.zeros((0, 4)))
        rows = numbers(elements, (start, "a", "b", "c", "d"), 0.0)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        return cls(rows[:, 0] + from_m, rows[:, 1:])

    def __len__(self) -> int:
        return len(self.starts)

    def at(self, s: Floats, end: float = np.inf) -> Floats:
        """Return the values (K,) at places (K,); 0 where there are no records.

        Records that start at `end` or later do not count: where a section ends, the one that ends there holds. What is
        before the first record has its first value.
        """
        if not len(self):
            return np.zeros(len(s))
        index = index_of(self.starts, s, end)
        ds = np.maximum(s - self.starts[index], 0.0)
        a, b, c, d = self.factors[index].T
        return np.asarray(a + ds * (b + ds * (c + ds * d)))


def index_of(starts: Floats, s: Floats, end: float = np.inf) -> Ints:
    """Return which record (K,) holds at places (K,): the last that starts there or before, and before `end`."""
    before = np.searchsorted(starts, np.minimum(s + _NEAR_M, end - _NEAR_M), side="right") - 1
    return np.maximum(before, 0)
