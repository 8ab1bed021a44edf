"""Finder of objects in a sweep without labels: places where a detector sees an object, or may see one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.learn.weights import load_detector
from coopsim.nn.inference.backend import find_backend
from coopsim.nn.inference.detectors import CloudDetector
from coopsim.support.checks import require_probability

_REACH_M = 76.8


class ObjectFinder:
    """Boxes that a detector finds in single sweeps.

    Args:
        weights: name of its weights, or path of their file.
        least_score: score from which a place is doubtful: a low one, as real objects are often found with low scores.
        device: device of the network.
    """

    def __init__(self, weights: str = "pillars", least_score: float = 0.15, device: str = "cpu") -> None:
        require_probability(least_score=least_score)
        self._detector, self._least_score = CloudDetector(load_detector(weights), find_backend(device, 1)), least_score

    def __call__(self, points: NDArray[np.float32]) -> Floats:
        """Return boxes (K, 7) in points (N, 4)."""
        aged = np.column_stack([points, np.zeros(len(points), np.float32)])
        (found,) = self._detector.detect_around([aged], _REACH_M, self._least_score)
        boxes: Floats = found.boxes.array
        return boxes
