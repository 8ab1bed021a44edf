"""What encoders make of sensor data, for others to fuse: point clouds, feature maps, instance queries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import frozen
from coopsim.types.sensing import Sweep
from coopsim.types.units import Ints


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """N points in the sender's base frame.

    Attributes:
        xyz: (N, 3) m, float32.
        intensity: (N,) in [0, 1], float32.
    """

    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "xyz", frozen(self.xyz, (None, 3), np.float32, "xyz"))
        object.__setattr__(self, "intensity", frozen(self.intensity, (len(self.xyz),), np.float32, "intensity"))

    @classmethod
    def of(cls, sweep: Sweep) -> PointCloud:
        """The points of a sweep."""
        return cls(sweep.points, sweep.intensity)

    @classmethod
    def empty(cls) -> PointCloud:
        """No points."""
        return cls(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def extent_m(self) -> float:
        """The largest coordinate, without its sign."""
        return float(np.abs(self.xyz).max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMap:
    """Features of a grid of cells around an agent; where the cells lie, sender and receiver must have agreed on.

    Attributes:
        values: (C, H, W) float32.
        confidence: (H, W) in [0, 1], how sure the sender is that there is something in a cell; None: it does not say.
    """

    values: NDArray[np.float32]
    confidence: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        values = frozen(self.values, (None, None, None), np.float32, "values")
        object.__setattr__(self, "values", values)
        if self.confidence is not None:
            confidence = frozen(self.confidence, values.shape[1:], np.float32, "confidence")
            object.__setattr__(self, "confidence", confidence)


@dataclass(frozen=True, slots=True, eq=False)
class InstanceQueries:
    """K queries in the sender's base frame.

    Attributes:
        feature: (K, D) float32.
        boxes: K reference boxes.
        score: (K,) confidence.
        label: (K,) int, an `ObjectClass`.
    """

    feature: NDArray[np.float32]
    boxes: Boxes3D
    score: Floats
    label: Ints

    def __post_init__(self) -> None:
        count = len(self.boxes)
        object.__setattr__(self, "feature", frozen(self.feature, (count, None), np.float32, "feature"))
        object.__setattr__(self, "score", frozen(self.score, (count,), np.float64, "score"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))

    def __len__(self) -> int:
        return len(self.boxes)
