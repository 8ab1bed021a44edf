"""Where2comm (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial Confidence Maps",
NeurIPS 2022): of each map only the cells are sent that the sender is sure of and the others ask for.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("where2comm")
@dataclass(kw_only=True, eq=False)
class Where2commFusion(LearnedFusion):
    """The surest cells of maps, by request, fused by attention with confidences. Parameters: `LearnedFusion`.

    With each message goes a request: how unsure its sender is, in blocks of 8 x 8 cells (256 bytes). The others' next
    messages have the cells first of which confidence times the largest request is largest (section 4.2; the published
    code has no requests). Unlike there, a message is a broadcast to all, not one for each receiver.
    """

    method = "Where2comm (Hu et al., 2022): selection, requests and fusion"

    codec = "sparse_features(most_cells=600, number=int8)"
    request_block = 8

    weights: str = "where2comm"
