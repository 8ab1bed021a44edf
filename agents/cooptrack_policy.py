"""CoopTrack (Zhong et al., "CoopTrack: Exploring End-to-End Learning for Efficient Cooperative Sequential Perception",
ICCV 2025): agents decode instances, and fuse them afterwards by what a graph between them says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from coopsim.agents.query_policy import QueryPolicy
from coopsim.catalog import POLICIES


@POLICIES.register("cooptrack")
@dataclass(kw_only=True, eq=False)
class CoopTrack(QueryPolicy):
    """Instances fused after decoding: aligned in two ways, matched by a graph, aggregated. Parameters: `QueryPolicy`.

    Unlike there, agents have LiDARs, any number of them take part, and the threshold can close.
    """

    method = "CoopTrack (Zhong et al., ICCV 2025), on LiDARs, for any number of agents"
    fusion: ClassVar[str] = "cooptrack"

    weights: str = "cooptrack"
