"""AttFuse (Xu et al., "OPV2V: An Open Benchmark Dataset and Fusion Pipeline for Perception with Vehicle-to-Vehicle
Communication", ICRA 2022): attention over agents, cell by cell.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("attfuse")
@dataclass(kw_only=True, eq=False)
class AttFusion(LearnedFusion):
    """Maps fused by dot-product attention of the receiver over the agents of a cell. Parameters: `LearnedFusion`.

    Unlike there, points are encoded in the sender's frame, not projected to the receiver's before, so that one
    broadcast serves all; and cells that an agent does not cover take no part.
    """

    method = "AttFuse's fusion (Xu et al., ICRA 2022) behind coopsim's encoder"

    weights: str = "attfuse"
