"""DINO-CoDT (He et al., "DINO-CoDT: Multi-class Collaborative Detection and Tracking with Vision Foundation Models",
2025) as a whole: its fusion in front, its rules of tracking behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from coopsim.agents.dino_codt_tracking import reid_in_words
from coopsim.agents.gsaf_policy import GSAFFusion
from coopsim.agents.perceiving_policy import Heard, base_SE3_compass
from coopsim.catalog import POLICIES
from coopsim.types import Detections, Observation

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder


@POLICIES.register("dino_codt")
@dataclass(kw_only=True, eq=False)
class DinoCoDT(GSAFFusion):
    """Maps fused by `gsaf`, and what is found in them tracked by `dino_codt_tracking`. Parameters: `LearnedFusion`.

    The paper's agents have LiDARs and cameras: `sensors="both"`. Messages carry maps and no pictures, so an object is
    described by the receiver's own ones.

    Attributes:
        embedder: name or spec of an embedder, as "picture_identity", that describes what is found; None: identity is by
            boxes alone. `counts` says how many boxes were tracked with an embedding, and how many without.
    """

    tracker: str = "dino_codt_tracking"
    embedder: str | None = None

    def load(self) -> None:
        super().load()
        sees = {"both": "points and pictures"}.get(self.sensors, self.sensors)
        self.method = (
            f"DINO-CoDT (He et al., 2025): fusion of maps of {sees} and tracking, {reid_in_words(self.embedder)}"
        )
        self._embedder: Embedder | None = None
        if self.embedder is not None:
            from coopsim.detection.embedder import make_embedder

            self._embedder = make_embedder(self.embedder)
            if self._embedder.needs.cameras and not self.needs.cameras:
                self.needs = replace(self.needs, cameras="surround", any_rig=True)

    def find(self, agent: str, observation: Observation, heard: Sequence[Heard]) -> Detections:
        found = super().find(agent, observation, heard)
        if self._embedder is None:
            return found
        seen = found.transform(base_SE3_compass(observation))
        return replace(found, embedding=self._embedder.apply(seen, observation.view(self.specs[agent])).embedding)
