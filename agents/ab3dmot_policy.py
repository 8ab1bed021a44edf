"""AB3DMOT (Weng et al., IROS 2020), the baseline tracker of the field, and the policies whose tracker it is."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.policy import Needs
from coopsim.agents.tracking_policy import TrackingPolicy
from coopsim.catalog import POLICIES
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.tracker import Tracker


@dataclass(kw_only=True, eq=False)
class AB3DMOTTracking(TrackingPolicy):
    """A policy that tracks with AB3DMOT. Further parameters: `TrackingPolicy`.

    Attributes:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until a track is dropped.
    """

    gate: float = -0.2
    hits: int = 3
    age: int = 2

    def make_tracker(self) -> Tracker:
        return ab3dmot(self.gate, self.hits, self.age)


@POLICIES.register("no_fusion", alias="ab3dmot")
@dataclass(kw_only=True, eq=False)
class NoFusion(AB3DMOTTracking):
    """AB3DMOT on the agent's own detections; reads no message: the lower bound that cooperation has to beat."""

    needs = Needs(uplink="none")
    method = "AB3DMOT (Weng et al., 2020) on the agent's own boxes"
