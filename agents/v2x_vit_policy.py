"""V2X-ViT (Xu et al., "V2X-ViT: Vehicle-to-Everything Cooperative Perception with Vision Transformer", ECCV 2022):
attention over agents by their kinds and delays, and in windows of several sizes.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("v2x_vit")
@dataclass(kw_only=True, eq=False)
class V2XViTFusion(LearnedFusion):
    """Maps fused by a transformer that knows kinds of agents and delays. Parameters: `LearnedFusion`.

    Unlike there, a delay is a real number of seconds, tokens stand for 2 x 2 cells, and fused cells begin as AttFuse's.
    """

    method = "V2X-ViT's fusion (Xu et al., ECCV 2022) behind coopsim's encoder"

    weights: str = "v2x_vit"
