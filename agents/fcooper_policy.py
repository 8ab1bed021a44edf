"""F-Cooper (Chen et al., SEC 2019): of all agents' features the largest of each channel and cell."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("fcooper")
@dataclass(kw_only=True, eq=False)
class FCooperFusion(LearnedFusion):
    """Maps fused by the maximum over agents (section 3.3, spatial feature fusion). Parameters: `LearnedFusion`.

    Unlike in the paper, the maps are the sender's own and are warped at the receiver, and few channels are sent.
    """

    method = "F-Cooper's spatial fusion (Chen et al., 2019); not its fusion of voxels"

    weights: str = "fcooper"
