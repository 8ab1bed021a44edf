"""The encoder of objects' points at work."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import Floats
from coopsim.nn.identity.object_points import join_points, points_in_boxes
from coopsim.nn.identity.point_encoder import PointIdentityNet
from coopsim.nn.inference.backend import PROCESSOR


class PointLooks:
    """Vectors of the objects in boxes.

    Args:
        net: with weights.
    """

    def __init__(self, net: PointIdentityNet) -> None:
        most: Any = net.config.points
        self._net, self._most, self.dim = net, int(most), net.dim

    def of(self, points: NDArray[np.floating], boxes: Floats) -> Floats:
        """Return vectors (N, D) of length 1; zeros where there are too few points, or a box is not finite.

        Args:
            points: (P, 4) x, y, z m and intensity.
            boxes: (N, 7) x, y, z, l, w, h, yaw in the same frame.
        """
        looks, finite = np.zeros((len(boxes), self.dim)), np.isfinite(boxes).all(axis=1)
        objects = points_in_boxes(points, boxes[finite], self._most)
        # Cosines of numbers of 8 bits would not tell much apart, and the network is small.
        with PROCESSOR.inference():
            looks[finite] = self._net(join_points(objects)).double().numpy()
        return looks
