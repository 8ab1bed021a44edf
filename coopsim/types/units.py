"""Array types and units of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats as Floats

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NS_PER_S = 1_000_000_000


def seconds_to_ns(seconds: float) -> int:
    """Convert seconds to integer nanoseconds, rounded to the nearest."""
    return round(seconds * NS_PER_S)
