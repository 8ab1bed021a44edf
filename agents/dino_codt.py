"""DINO-CoDT (He et al., "DINO-CoDT: Multi-class Collaborative Detection and Tracking with Vision Foundation Models",
2025) as a whole: its fusion in front, its rules of tracking behind.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.gsaf_policy import GSAFFusion
from coopsim.catalog import POLICIES


@POLICIES.register("dino_codt")
@dataclass(kw_only=True, eq=False)
class DinoCoDT(GSAFFusion):
    """Maps fused by `gsaf`, and what is found in them tracked by `dino_codt_tracking`. Parameters: `LearnedFusion`.

    The paper's agents have LiDARs and cameras: `sensors="both"`. Identities from pictures need an embedder.
    """

    tracker: str = "dino_codt_tracking"
