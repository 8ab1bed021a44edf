"""No fusion: each agent on its own, the lower bound that cooperation has to beat."""

from __future__ import annotations

from coopsim.agents.ab3dmot_policy import AB3DMOT
from coopsim.catalog import POLICIES


@POLICIES.register("no_fusion")
class NoFusion(AB3DMOT):
    """What an agent tracks without any message: AB3DMOT on its own detections."""
