"""UniV2X's agent fusion (Yu et al., "End-to-End Autonomous Driving through V2X Cooperation", AAAI 2025): queries are
matched by distance and added, before they are decoded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from coopsim.agents.query_policy import QueryPolicy
from coopsim.catalog import POLICIES


@POLICIES.register("univ2x")
@dataclass(kw_only=True, eq=False)
class UniV2X(QueryPolicy):
    """Queries fused before decoding: matched by distance within the box's size, and added. Parameters: `QueryPolicy`.

    Unlike there, agents have LiDARs, any number of them take part, and the network of one agent is that of CoopTrack:
    what differs between the two is how agents cooperate. `least_affinity` matters only above 1: then none are matched.
    """

    method = "UniV2X's fusion of agents (Yu et al., AAAI 2025), on CoopTrack's network of one agent"
    fusion: ClassVar[str] = "univ2x"

    weights: str = "univ2x"
