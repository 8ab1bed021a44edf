"""The base of policies that know objects again by their looks, and send these along with the boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from coopsim.agents.late_fusion import PooledBoxes
from coopsim.comms.uplinks.share_embedded import EmbedOnce, ShareEmbedded
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.types import AgentSpec, Detections, Observation

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder


@dataclass(kw_only=True, eq=False)
class DescribedBoxes(PooledBoxes):
    """A policy each of whose agents describes its own detections once a frame. Parameters: `PooledBoxes`."""

    def __post_init__(self) -> None:
        embedder = self.make_embedder()
        self._embed = None if embedder is None else EmbedOnce(embedder)
        super().__post_init__()

    def make_embedder(self) -> Embedder | None:
        """Make what describes detections; None: they stay as the environment has them."""
        return None

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if self._embed is None:
            return super().make_uplink(spec, rng)
        return ShareEmbedded(self._embed, spec, spec.codec or "detections", self.velocities)

    def perceive(self, agent: str, observation: Observation) -> Detections:
        return observation.detections if self._embed is None else self._embed(observation, self.specs[agent])
