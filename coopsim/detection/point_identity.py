"""The embedder "point_identity": a network on the points in a box (YOLOO's LGPEnc, Gu et al.).

Importing this does not load torch; making the embedder does.
"""

from __future__ import annotations

import numpy as np

from coopsim.detection.detector import SensorNeeds
from coopsim.detection.embedder import EMBEDDERS, Embedder
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, PointCloud, SensorView


@EMBEDDERS.register("point_identity")
class PointIdentity(Embedder):
    """What an object looks like in an agent's own points; nothing for boxes with fewer than five.

    Args:
        weights: of the network, by name or as the path of a file.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: the weights are broken, or of something else.
    """

    needs = SensorNeeds(lidar=True)

    def __init__(self, weights: str = "point_identity") -> None:
        if not isinstance(weights, str):
            raise InvalidValueError(f"weights must be the name or path of weights, got {weights!r}")
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.weights import load_point_identity
        from coopsim.nn.identity.point_encoder import PointEmbedder

        self._looks = PointEmbedder(load_point_identity(weights))
        self.dim = self._looks.dim

    def embed(self, detections: Detections, view: SensorView) -> Floats:
        if not (len(detections) and view.sweeps):
            return np.zeros((len(detections), self.dim))
        cloud = PointCloud.of(*view.sweeps.values())
        return self._looks.of(np.column_stack([cloud.xyz, cloud.intensity]), detections.boxes.array)
