"""CoBEVT (Xu et al., "CoBEVT: Cooperative Bird's Eye View Semantic Segmentation with Sparse Transformers", CoRL 2022):
attention over agents and space, among neighbours and over the whole map.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("cobevt")
@dataclass(kw_only=True, eq=False)
class CoBEVTFusion(LearnedFusion):
    """Maps fused by fused axial attention. Parameters: `LearnedFusion`.

    Unlike there, maps are of points, tokens stand for 2 x 2 cells, and fused cells begin as AttFuse's.
    """

    method = "CoBEVT's fusion (Xu et al., CoRL 2022) of maps of points; not its cameras"

    weights: str = "cobevt"
