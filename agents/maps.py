"""Policies on maps of features: a row for each published fusion. The network itself is in `coopsim.nn.fusion`.

All of them differ from their papers in this: points are encoded in the sender's frame, so that one broadcast serves all
receivers, few channels are sent, and each cell's age is given to the layer that expands it.

A method of your own is a class of the same few lines, with the name of your weights; see "Train your own fusion".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from coopsim.agents.appearance import reid_in_words
from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.agents.perceiving_policy import Received, base_SE3_compass
from coopsim.agents.tracking_policy import policy_row
from coopsim.support.checks import require_flag
from coopsim.types import Detections, Observation

if TYPE_CHECKING:
    from coopsim.detection.embedder import Embedder
    from coopsim.nn.cooperative.cooperative_net import CooperativeNet
    from coopsim.nn.cooperative.flow_sender import FlowSender


@policy_row("fcooper", weights="fcooper")
class FCooperFusion(LearnedFusion):
    """Maximum over agents (Chen et al., "F-Cooper", SEC 2019, section 3.3). Parameters: `LearnedFusion`."""

    method = "F-Cooper's spatial fusion (Chen et al., 2019); not its fusion of voxels"


@policy_row("attfuse", weights="attfuse")
class AttFusion(LearnedFusion):
    """Attention of the receiver over the agents of a cell (Xu et al., "OPV2V", ICRA 2022). Parameters: `LearnedFusion`.

    Cells that an agent does not cover take no part.
    """

    method = "AttFuse's fusion (Xu et al., ICRA 2022) behind coopsim's encoder"


@policy_row("v2vnet", weights="v2vnet")
class V2VNetFusion(LearnedFusion):
    """Graph network with a convolutional GRU (Wang et al., "V2VNet", ECCV 2020). Parameters: `LearnedFusion`."""

    method = "V2VNet's fusion (Wang et al., 2020); not its prediction of motion"


@policy_row("disconet", weights="disconet")
class DiscoNetFusion(LearnedFusion):
    """Weight of each pair of agents in each cell, taught by a network that sees all points (Li et al., "Learning
    Distilled Collaboration Graph for Multi-Agent Perception", NeurIPS 2021). Parameters: `LearnedFusion`.
    """

    method = "DiscoNet (Li et al., 2021), fusion and teacher"


@policy_row("v2x_vit", weights="v2x_vit")
class V2XViTFusion(LearnedFusion):
    """Transformer over kinds of agents, delays and windows (Xu et al., "V2X-ViT", ECCV 2022).

    Tokens stand for 2 x 2 cells. Parameters: `LearnedFusion`.
    """

    method = "V2X-ViT's fusion (Xu et al., ECCV 2022) behind coopsim's encoder"


@policy_row("cobevt", weights="cobevt")
class CoBEVTFusion(LearnedFusion):
    """Fused axial attention over agents and space (Xu et al., "CoBEVT", CoRL 2022). Parameters: `LearnedFusion`."""

    method = "CoBEVT's fusion (Xu et al., CoRL 2022) of maps of points; not its cameras"


@policy_row("where2comm", weights="where2comm")
class Where2commFusion(LearnedFusion):
    """Cells by confidence and request, fused by attention (Hu et al., "Where2comm", NeurIPS 2022).

    With each message goes a request: how unsure its sender is, in blocks of 8 x 8 cells (256 bytes). The others' next
    messages have the cells first of which confidence times the largest request is largest (section 4.2; the published
    code has no requests). Unlike there, a message is a broadcast to all. Parameters: `LearnedFusion`.
    """

    method = "Where2comm (Hu et al., 2022): selection, requests and fusion"
    codec = "sparse_features(most_cells=600, number=int8)"
    request_block = 8


@policy_row("pyramid", weights="pyramid")
class PyramidFusion(LearnedFusion):
    """Several scales, weighted by each agent's foreground (Lu et al., "An Extensible Framework for Open Heterogeneous
    Collaborative Perception", HEAL, ICLR 2024). Parameters: `LearnedFusion`.
    """

    method = "HEAL's pyramid fusion (Lu et al., 2024); not its encoders of many kinds"


@policy_row("gsaf", weights="gsaf")
class GSAFFusion(LearnedFusion):
    """Global spatial attention fusion: windows of several sizes, then a weight for each agent and cell (He et al.,
    "DINO-CoDT: Multi-class Collaborative Detection and Tracking with Vision Foundation Models", 2025).

    `dino_codt` has the paper's rules of tracking behind it. Parameters: `LearnedFusion`.
    """

    method = "DINO-CoDT (He et al., 2025), its fusion of maps alone"


@policy_row("dino_codt")
class DinoCoDT(GSAFFusion):
    """Fusion by `gsaf`, tracking by `dino_codt_tracking`: DINO-CoDT as a whole. Further parameters: `LearnedFusion`.

    The paper's agents have LiDARs and cameras: `sensors="both"`. Messages carry maps and no pictures, so an object is
    described by the receiver's own ones.

    Attributes:
        embedder: name or spec of an embedder, such as "picture_identity", that describes detections; None: identity is
            by boxes alone. `counts` has the numbers of boxes tracked with and without an embedding.
    """

    tracker: str = "dino_codt_tracking"
    embedder: str | None = None

    def load(self) -> None:
        super().load()
        sees = {"both": "points and pictures"}.get(self.sensors, self.sensors)
        self.method = (
            f"DINO-CoDT (He et al., 2025): fusion of maps of {sees} and tracking, {reid_in_words(self.embedder)}"
        )
        self._embedder: Embedder | None = None
        if self.embedder is not None:
            from coopsim.detection.embedder import make_embedder

            self._embedder = make_embedder(self.embedder)
            if self._embedder.needs.cameras and not self.needs.cameras:
                self.needs = replace(self.needs, cameras="surround", any_rig=True)

    def find(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        found = super().find(agent, observation, received)
        if self._embedder is None:
            return found
        seen = found.transform(base_SE3_compass(observation))
        return replace(found, embedding=self._embedder.apply(seen, observation.view(self.specs[agent])).embedding)


@policy_row("ff_tracking")
class FFTrackingFusion(LearnedFusion):
    """Feature flow: late maps are moved to now before they are fused (Hu, Wang and Wang, "Integrated Detection and
    Tracking Framework for 3D Multi-Object Tracking in Vehicle-Infrastructure Cooperation", eq. 5-11).

    A message has the compressed features F and their derivative F' per second. The receiver warps, expands and fuses
    F + dt F', dt being the message's own delay. Further parameters: `LearnedFusion`.

    Attributes:
        flow: send derivatives; False: the same network without them.
    """

    method = "Hu et al.'s feature flow (eq. 5-11) behind coopsim's encoder; AB3DMOT, not their integrated tracking"

    weights: str = "ff_tracking"
    flow: bool = True

    def __post_init__(self) -> None:
        require_flag(flow=self.flow)
        super().__post_init__()

    def make_flow(self, net: CooperativeNet) -> FlowSender | None:
        return super().make_flow(net) if self.flow else None
