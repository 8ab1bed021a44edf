"""Pyramid fusion of HEAL (Lu et al., "An Extensible Framework for Open Heterogeneous Collaborative Perception", ICLR
2024): at several scales, agents weigh by the foreground that each believes in.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("pyramid")
@dataclass(kw_only=True, eq=False)
class PyramidFusion(LearnedFusion):
    """Maps fused at several scales, weighted by each agent's foreground. Parameters: `LearnedFusion`.

    Unlike there, few channels are sent, and all agents have the same encoder: heterogeneous ones are not part of it.
    """

    method = "HEAL's pyramid fusion (Lu et al., 2024); not its encoders of many kinds"

    weights: str = "pyramid"
