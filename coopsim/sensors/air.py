"""The weather between a sensor and the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.checks import require_between, require_number


@dataclass(frozen=True, slots=True)
class Weather:
    """The weather around a sensor.

    Attributes:
        rain_mm_h: rain rate: 2.5 is light, 10 moderate, 50 violent; at most 200.
        fog_visibility_m: how far one sees (contrast falls to 5 %); below 1000 m it is called fog. Inf: clear air.
        wetness: share of all surfaces under a film of water, in [0, 1].
    """

    rain_mm_h: float = 0.0
    fog_visibility_m: float = np.inf
    wetness: float = 0.0

    def __post_init__(self) -> None:
        require_between(0, 200, rain_mm_h=self.rain_mm_h)
        require_number("a number >= 5, inf for clear air", lambda far: far >= 5, fog_visibility_m=self.fog_visibility_m)
        require_between(0, 1, wetness=self.wetness)
