"""Embedders by networks: "point_identity" on an object's points, "picture_identity" and "dinov2" on its image crops.

"point_identity" is YOLOO's LGPEnc (Gu et al.). Importing this does not load torch; making an embedder does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from coopsim.detection.detector import SensorNeeds
from coopsim.detection.embedder import EMBEDDERS, Embedder
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.camera.projection import LEAST_AREA_PX, best_crops, hidden_shares
from coopsim.support.checks import require_between, require_count, require_positive, require_probability
from coopsim.types import Detections, PointCloud, SensorView

if TYPE_CHECKING:
    from torch import Tensor


@EMBEDDERS.register("point_identity")
class PointIdentity(Embedder):
    """Appearance of objects in an agent's own points; nothing for boxes with fewer than five.

    Args:
        weights: name of the network's weights, or path of their file.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: the weights are broken, or those of something else.
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


class CropEmbedder(Embedder):
    """Network on the crops of detections, each from the image that shows most of it.

    A detection outside all images has no embedding, nor has one whose crop is smaller than `least_area_px`, or covered
    by that of a nearer detection for more than the share `most_hidden`. The network turns crops (K, 3, E, E) in [0,
    255] into vectors (K, `dim`); E is `edge_px`, and a crop has the share `margin` of its width and height around the
    box.
    """

    needs = SensorNeeds(cameras=True)

    def __init__(
        self,
        network: Callable[[Tensor], Tensor],
        dim: int,
        edge_px: int,
        margin: float,
        least_area_px: float,
        most_hidden: float,
    ) -> None:
        require_positive(least_area_px=least_area_px)
        require_probability(most_hidden=most_hidden)
        self.dim, self._network = dim, network
        self._edge_px, self._margin = edge_px, margin
        self._least_area_px, self._most_hidden = least_area_px, most_hidden

    def embed(self, detections: Detections, view: SensorView) -> Floats:
        from coopsim.nn.identity.picture_identity_net import cut_crops
        from coopsim.nn.inference.backend import find_backend

        vectors = np.zeros((len(detections), self.dim))
        pictures = {name: image.rgb for name, image in view.images.items() if image.rgb is not None}
        crops = best_crops({name: view.cameras[name] for name in pictures}, detections.boxes, self._least_area_px)
        away_m = np.linalg.norm(detections.boxes.center, axis=1)
        clear = crops.known & (hidden_shares(crops, away_m) <= self._most_hidden)
        if not clear.any():
            return vectors
        import torch

        rows = [np.flatnonzero(clear & (crops.camera == number)) for number in range(len(pictures))]
        with find_backend().inference():
            cut = [
                cut_crops(rgb, crops.place_px[row], self._edge_px, self._margin)
                for rgb, row in zip(pictures.values(), rows, strict=True)
            ]
            vectors[np.concatenate(rows)] = self._network(torch.cat(cut)).double().numpy()
        return vectors


@EMBEDDERS.register("picture_identity")
class PictureIdentity(CropEmbedder):
    """Vectors of a small network that was trained for identity in the simulator's images; see `CropEmbedder`.

    Args:
        weights: name of the network's weights, or path of their file.
        least_area_px: area of the smallest crop, in pixels.
        most_hidden: largest share of a crop that a nearer detection's may cover, in [0, 1].

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: a value is not accepted, or the weights are broken.
    """

    def __init__(
        self, weights: str = "picture_identity", least_area_px: float = LEAST_AREA_PX, most_hidden: float = 0.6
    ) -> None:
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.weights import load_picture_identity
        from coopsim.nn.inference.encoders import folded

        net = load_picture_identity(weights)
        config = net.config
        super().__init__(folded(net), config.dim, config.edge_px, config.margin, least_area_px, most_hidden)


@EMBEDDERS.register("dinov2")
class DinoV2Identity(CropEmbedder):
    """Tokens of DINOv2, as the paper on DINO-CoDT has them; see `coopsim.nn.identity.dinov2` and `CropEmbedder`.

    Args:
        model: folder of the model, or its id on the hub, such as "facebook/dinov2-giant".
        block: number of the block whose output is taken, from 1; None: 31, or the last one if there are fewer.
        pooling: "class" token, or "mean" of the patches' tokens.
        edge_px: edge of a resized crop; a multiple of the model's patches, of 14 pixels.
        margin: share of width and height that a crop has around the box, on each side; the paper has none.
        least_area_px: area of the smallest crop, in pixels.
        most_hidden: largest share of a crop that a nearer detection's may cover, in [0, 1].

    Raises:
        MissingDependencyError: torch or `transformers` is not installed.
        UnknownNameError: there is no such pooling.
        InvalidValueError: a value is not accepted, or there is no such model.
    """

    def __init__(
        self,
        model: str,
        block: int | None = None,
        pooling: str = "class",
        edge_px: int = 112,
        margin: float = 0.0,
        least_area_px: float = LEAST_AREA_PX,
        most_hidden: float = 0.6,
    ) -> None:
        require_count(1, 2048, edge_px=edge_px)
        require_between(0, 2, margin=margin)
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.nn.identity.dinov2 import DinoV2

        net = DinoV2(model, block, pooling)
        if edge_px % net.patch_px:
            raise InvalidValueError(f"edge_px must be a multiple of {net.patch_px}, the model's patches, got {edge_px}")
        super().__init__(net, net.dim, edge_px, margin, least_area_px, most_hidden)
