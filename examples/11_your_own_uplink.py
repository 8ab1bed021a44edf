"""Plug in your own uplink: one method. This one sends in every third frame only; a policy brings it along."""

import numpy as np

import coopsim
from coopsim.agents.boxes import LateFusion
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.testing import check_uplink
from coopsim.types import AgentSpec, Observation


class ShareInTurn(ShareDetections):
    """Detections of every third frame; each agent draws in which of three it begins, so that they take turns."""

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self.frames_to_wait = int(rng.integers(3))

    def content_of(self, sender: str, observation: Observation) -> object:
        self.frames_to_wait = (self.frames_to_wait - 1) % 3
        return super().content_of(sender, observation) if self.frames_to_wait == 0 else None


class ThriftyFusion(LateFusion):
    """Late fusion of what others send now and then."""

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        return ShareInTurn(spec.codec or "detections")


check_uplink(ThriftyFusion())
for policy in (LateFusion(), ThriftyFusion(age=4)):
    score = coopsim.evaluate(policy, "crossing", seed=1, max_cycles=50, lidar=None).score
    print(f"{type(policy).__name__:>13}: MOTA {score['MOTA']:.1f} %, {score['bytes_per_s']:.0f} bytes/s per agent")
