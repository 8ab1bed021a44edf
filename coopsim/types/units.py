"""Array types and units of time."""

from __future__ import annotations

from coopsim.support.arrays import Floats as Floats
from coopsim.support.arrays import Ints as Ints
from coopsim.support.arrays import Mask as Mask

NS_PER_S = 1_000_000_000


def seconds_to_ns(seconds: float) -> int:
    """Convert seconds to integer nanoseconds, rounded to the nearest."""
    return round(seconds * NS_PER_S)
