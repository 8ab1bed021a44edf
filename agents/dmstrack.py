"""DMSTrack (Chiu et al., "Probabilistic 3D Multi-Object Cooperative Tracking for Autonomous Driving via Differentiable
Multi-Sensor Kalman Filter", ICRA 2024), its positional variant: every box has a covariance of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coopsim.agents.ab3dmot_policy import AB3DMOTTracking
from coopsim.agents.sequential_kf import SequentialKF
from coopsim.catalog import POLICIES
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec


@POLICIES.register("dmstrack")
@dataclass(kw_only=True, eq=False)
class DMSTrack(AB3DMOTTracking):
    """The multi-sensor Kalman filter with a learned covariance of each box. Parameters: `AB3DMOTTracking`.

    The receiver's boxes update the tracks first, then each sender's in turn. The noise of the motion is that with which
    the covariances were trained; with `covariance=None` the policy is `sequential_kf`.
    """

    method = "DMSTrack (Chiu et al., 2024), positional: covariances learned from boxes; none of its features"

    covariance: str | None = "dmstrack"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self._covariance is None:
            self.method = SequentialKF.method
        elif self._covariance.stated_by_detector:
            self.method = "DMSTrack (Chiu et al., 2024): covariances learned from what the detector's map shows"

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if spec.codec is None and self._covariance is not None and self._covariance.stated_by_detector:
            spec = replace(spec, codec="compact")  # which has room for covariances
        return super().make_uplink(spec, rng)

    def make_tracker(self) -> Tracker:
        motion = None if self._covariance is None else self._covariance.motion()
        return ab3dmot(self.gate, self.hits, self.age, motion=motion)
