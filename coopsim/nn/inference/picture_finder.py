"""The network of one agent with cameras at work: from pictures to detections."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from coopsim.nn.camera.picture_batch import PictureView, SeenPicture, collate_pictures
from coopsim.nn.camera.picture_detector import PictureDetectorNet
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.inference.inference import inference, side_by_side
from coopsim.nn.inference.perceiver import compass_region
from coopsim.nn.inference.quick import folded
from coopsim.nn.inference.quick_pictures import QuickPictureEncoder
from coopsim.types import BevGrid, Detections


class PictureFinder:
    """A `PictureDetectorNet` that looks for objects in pictures.

    Args:
        net: the network.
        threads: agents' pictures are looked at side by side on so many.
    """

    def __init__(self, net: PictureDetectorNet, threads: int = 1) -> None:
        self._encoder, self._head = QuickPictureEncoder(net.encoder), folded(net.head)
        self._cell_m, self._threads = STRIDE * net.config.cell_m, threads

    def detect_around(
        self, agents: Sequence[Sequence[SeenPicture]], reach_m: float, least_score: float
    ) -> list[Detections]:
        """Return the detections in the pictures of A agents, in a square of +-`reach_m` around each, in base frames.

        Args:
            agents: of each its pictures; one without any has no detections.
            reach_m: half the edge of the square.
            least_score: smallest score of a detection.
        """
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        return side_by_side([partial(self._detect, region, least_score, each) for each in agents], self._threads)

    def _detect(self, region: BevGrid, least_score: float, pictures: Sequence[SeenPicture]) -> Detections:
        if not pictures:
            return Detections.empty()
        canvas = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        with inference():
            features = self._encoder(collate_pictures([PictureView(pictures, np.zeros(3), canvas)]))
            return decode(self._head, features, region, least_score=least_score)[0]
