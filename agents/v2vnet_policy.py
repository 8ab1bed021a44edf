"""V2VNet (Wang et al., "V2VNet: Vehicle-to-Vehicle Communication for Joint Perception and Prediction", ECCV 2020): a
graph of agents that send each other messages.
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.catalog import POLICIES


@POLICIES.register("v2vnet")
@dataclass(kw_only=True, eq=False)
class V2VNetFusion(LearnedFusion):
    """Maps fused by a graph network with a convolutional GRU. Parameters: `LearnedFusion`.

    Unlike there, it detects and does not predict motion, and messages' delays are given to the layer that expands them.
    """

    method = "V2VNet's fusion (Wang et al., 2020); not its prediction of motion"

    weights: str = "v2vnet"
