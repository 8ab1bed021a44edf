"""The multi-sensor Kalman filter: the boxes of one agent after another update the same tracks.

The baseline of DMSTrack (Chiu et al., ICRA 2024) and of Graph Lap-CoMOT (Damanaki et al., 2025).
"""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.agents.ab3dmot_policy import AB3DMOTTracking
from coopsim.catalog import POLICIES


@POLICIES.register("sequential_kf")
@dataclass(kw_only=True, eq=False)
class SequentialKF(AB3DMOTTracking):
    """AB3DMOT on the receiver's boxes first, then on each sender's in turn. Parameters: `AB3DMOTTracking`.

    Each agent's boxes are matched to the tracks as the agents before left them. A box that matches no track begins
    one, whichever agent it comes from.
    """

    method = "the multi-sensor Kalman filter that DMSTrack (Chiu et al., 2024) starts from, with fixed noise"
