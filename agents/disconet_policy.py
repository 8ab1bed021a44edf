"""DiscoNet (Li et al., "Learning Distilled Collaboration Graph for Multi-Agent Perception", NeurIPS 2021): a weight for
each agent and cell, taught by a network that sees the points of all.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("disconet")
@dataclass(kw_only=True, eq=False)
class DiscoNetFusion(LearnedFusion):
    """Maps fused by weights of each pair of agents in each cell. Parameters: `LearnedFusion`.

    Unlike there, points are encoded in the sender's frame, not projected to the receiver's before, and the teacher's
    and the fused map are compared where the head reads them.
    """

    method = "DiscoNet (Li et al., 2021), fusion and teacher"

    weights: str = "disconet"
