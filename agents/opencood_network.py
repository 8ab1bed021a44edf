"""The base of policies whose network takes OpenCOOD's batch: `processed_lidar`, `record_len`, `pairwise_t_matrix`."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coopsim.agents.boxes import AB3DMOTTracking
from coopsim.agents.policy import Needs
from coopsim.comms.envelope import decode_points
from coopsim.geometry.se3 import SE3
from coopsim.learn.opencood import Layout, make_sample
from coopsim.types import Detections, ObjectClass, Observation, PointCloud


@dataclass(kw_only=True, eq=False)
class OpenCoodNetwork(AB3DMOTTracking):
    """A policy around a network that takes the points of all agents in one batch. Further: `AB3DMOTTracking`.

    Agents send their points, so bytes are those of early fusion, also where the network fuses features within. To
    measure the bytes of features, split the network at its encoder, as `examples/24_bring_your_network.py` does.

    Attributes:
        layout: choices of the network.
        device: device of the batch: "cpu", "cuda", "cuda:1" or "auto".
    """

    needs = Needs(uplink="points", lidar=True)
    layout: Layout = field(default_factory=Layout)
    device: str = "cpu"

    @abstractmethod
    def forward(self, batch: dict[str, Any]) -> tuple[Any, Any]:
        """Return boxes (N, 7), rows of the layout in the receiver's frame, and scores (N,), as tensors.

        Args:
            batch: tensors by key, see `coopsim.learn.opencood`; a batch of one sample without objects.
        """

    def perceive(self, agent: str, observation: Observation) -> Detections:
        import torch

        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.opencood_frames import as_tensors
        from coopsim.nn.inference.backend import find_device

        base_SE3_world = observation.pose.world_SE3_base.inverse()
        clouds, placed = [PointCloud.of(*observation.sweeps.values())], [SE3.from_xyz_yaw(np.zeros(3), 0.0)]
        for message, cloud in self.read(agent, observation.inbox, decode_points):
            clouds.append(cloud)
            placed.append(base_SE3_world.compose(message.pose.world_SE3_base))
        batch = make_sample(self.layout, clouds, placed)
        with torch.no_grad():
            rows, scores = self.forward(as_tensors(batch, find_device(self.device)))
        boxes = self.layout.to_boxes(np.asarray(rows.cpu(), np.float64))
        return Detections(boxes, np.asarray(scores.cpu(), np.float64), np.full(len(boxes), ObjectClass.CAR))
