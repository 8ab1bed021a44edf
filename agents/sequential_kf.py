"""The multi-sensor Kalman filter: one agent's boxes after another's update the same tracks.

The baseline of DMSTrack (Chiu et al., ICRA 2024) and of Graph Lap-CoMOT (Damanaki et al., 2025).
"""

from __future__ import annotations

from coopsim.agents.ab3dmot_policy import AB3DMOTBased
from coopsim.catalog import POLICIES


@POLICIES.register("sequential_kf")
class SequentialKF(AB3DMOTBased):
    """AB3DMOT, its own boxes first, then each other agent's matched to the tracks as the ones before left them.

    What no track matches begins one, whoever saw it.
    """
