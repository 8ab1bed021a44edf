"""GSAF, the fusion of DINO-CoDT (He et al., "DINO-CoDT: Multi-class Collaborative Detection and Tracking with Vision
Foundation Models", 2025): windows of several sizes in each agent's map, then a weight for each agent and cell.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("gsaf")
@dataclass(kw_only=True, eq=False)
class GSAFFusion(LearnedFusion):
    """Maps fused by global spatial attention fusion, of points alone. Parameters: `LearnedFusion`.

    With `tracker="dino_codt_tracking"` the paper's rules of tracking are behind it. Unlike there, tokens stand for
    2 x 2 cells, and fused cells begin as AttFuse's.
    """

    method = "DINO-CoDT (He et al., 2025), its fusion of maps alone"

    weights: str = "gsaf"
