"""FF-Tracking, the feature flow of Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D Multi-Object
Tracking in Vehicle-Infrastructure Cooperation", eq. 5-11: late maps are moved to now before they are fused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES
from coopsim.support.checks import require_flag

if TYPE_CHECKING:
    from coopsim.nn.cooperative.cooperative_net import CooperativeNet
    from coopsim.nn.inference.flow_sender import FlowSender


@POLICIES.register("ff_tracking")
@dataclass(kw_only=True, eq=False)
class FFTrackingFusion(LearnedFusion):
    """Maps with their derivatives, moved to now by their delays and fused. Further parameters: `LearnedFusion`.

    A message has the compressed features F and their derivative F' per second. The receiver takes F + dt F', dt being
    the message's own delay, and warps, expands and fuses that (eq. 8-11).

    Attributes:
        flow: send derivatives; False: maps alone, which are then taken as they were: the same network without flow.
    """

    method = "Hu et al.'s feature flow (eq. 5-11) behind coopsim's encoder; AB3DMOT, not their integrated tracking"

    weights: str = "ff_tracking"
    flow: bool = True

    def __post_init__(self) -> None:
        require_flag(flow=self.flow)
        super().__post_init__()

    def make_flow(self, net: CooperativeNet) -> FlowSender | None:
        return super().make_flow(net) if self.flow else None
