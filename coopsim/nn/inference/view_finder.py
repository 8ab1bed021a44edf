"""The network of one agent at work on whatever its sensors gave: from views to detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from coopsim.nn.detector.centre_head import CentreHead
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.inference.agent_encoder import AgentEncoder, Look, encoded
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.perceiver import compass_region
from coopsim.nn.inference.quick import folded
from coopsim.types import BevGrid, Detections, SensorView


class ViewFinder:
    """An encoder and a head that look for objects in what agents see.

    Args:
        encoder: of an agent's sensor data.
        head: on its features.
        cell_m: edge of a cell of the encoder's canvas.
        backend: on which encoder and head compute.
    """

    def __init__(self, encoder: AgentEncoder, head: CentreHead, cell_m: float, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._head = encoder, backend.place(folded(head))
        self._cell_m, self._backend = STRIDE * cell_m, backend

    def detect_around(self, views: Sequence[SensorView], reach_m: float, least_score: float) -> list[Detections]:
        """Return the detections of A agents, in a square of +-`reach_m` around each, in base frames.

        Args:
            views: what each agent sees.
            reach_m: half the edge of the square.
            least_score: smallest score of a detection.
        """
        region = compass_region((reach_m, reach_m), 0.0, self._cell_m)
        # Without a pose, the axes are those of the base frame.
        looks = [self._encoder.look(replace(view, pose=None)) for view in views]
        return self._backend.map(partial(self._detect, region, least_score), looks)

    def _detect(self, region: BevGrid, least_score: float, looks: Sequence[Look]) -> list[Detections]:
        canvas = BevGrid(region.x_m, region.y_m, region.cell_m / STRIDE)
        with self._backend.inference():
            return decode(self._head, encoded(looks, [canvas] * len(looks)), region, least_score=least_score)
