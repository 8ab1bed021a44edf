"""Ranges of sensors and ground for realistic clips, by recipe, where they differ from those of `realism`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coopsim.learn.clips.ranges import as_range
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.support.checks import require_probability

_LIMITS = {
    "gain": (1e-3, 100.0),
    "gamma": (0.1, 10.0),
    "offset": (0.0, 1.0),
    "fade": (-2.0, 2.0),
    "lost_share": (0.0, 1.0),
    "bloom_rad": (0.0, 0.02),
    "mount_m": (0.2, 10.0),
    "grade": (0.0, 0.3),
    "roughness_m3": (1e-7, 0.1),
}
_OF_IMPERFECTIONS = ("gain", "gamma", "offset", "fade", "lost_share", "bloom_rad")
_BY_FACTORS = ("gain", "roughness_m3")


@dataclass(frozen=True, slots=True)
class SensorRanges:
    """Ranges, as pairs of their ends, of which each realistic clip draws a value; None: as usual.

    Attributes:
        gain: factor on reported intensities; its logarithm is uniform. This and the next five are fields of
            `Imperfections`.
        gamma: exponent of reported intensities.
        offset: added to reported intensities.
        fade: exponent by which reported intensities fall with the range.
        lost_share: share of the returns that are lost whatever their energy.
        bloom_rad: angle over which the stray light around retro-reflectors falls.
        mount_m: height of cars' LiDARs over the ground; on bodies that are higher, they stay on the roof.
        grade: steepest rise of hills.
        roughness_m3: spectral density of the ground's heights at 0.1 cycles a metre (ISO 8608: to 16e-6 is class A,
            and 4 times as much for each class after it); its logarithm is uniform.
        ego_share: share of the clips in which LiDARs see the car that carries them.
    """

    gain: Sequence[float] | None = None
    gamma: Sequence[float] | None = None
    offset: Sequence[float] | None = None
    fade: Sequence[float] | None = None
    lost_share: Sequence[float] | None = None
    bloom_rad: Sequence[float] | None = None
    mount_m: Sequence[float] | None = None
    grade: Sequence[float] | None = None
    roughness_m3: Sequence[float] | None = None
    ego_share: float = 0.0

    def __post_init__(self) -> None:
        require_probability(ego_share=self.ego_share)
        object.__setattr__(self, "ego_share", float(self.ego_share))
        for name, limits in _LIMITS.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_range(name, getattr(self, name), *limits))

    def draw(self, name: str, rng: Callable[[str], np.random.Generator]) -> float | None:
        """Draw a value by the random stream of its purpose; None: as usual."""
        ends = getattr(self, name)
        if ends is None:
            return None
        at = rng(f"sensor {name}").random()
        if name in _BY_FACTORS:
            low, high = (math.log(end) for end in ends)
            return math.exp(low + at * (high - low))
        return float(ends[0] + at * (ends[1] - ends[0]))

    def built(self, lidar: LidarConfig, rng: Callable[[str], np.random.Generator]) -> LidarConfig:
        """Return a LiDAR with the imperfections that these ranges say."""
        assert lidar.imperfections is not None
        drawn = {name: self.draw(name, rng) for name in _OF_IMPERFECTIONS}
        given: dict[str, Any] = {name: value for name, value in drawn.items() if value is not None}
        return replace(lidar, imperfections=replace(lidar.imperfections, **given))
