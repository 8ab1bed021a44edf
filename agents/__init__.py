"""Policies: from each agent's observation to the tracks that it reports.

Read `policy` (the interface), then `tracking_policy` (the base of all that track boxes), then `perceiving_policy` (that
of all with a network). A method of your own stands beside its like in `boxes`, `appearance`, `maps` or `queries`, or in
a file of its own like `coop_fuse`. Importing this package registers the policies on boxes; `networks` has the others.
"""

from typing import TYPE_CHECKING

from coopsim.agents import boxes, coop_fuse, graph_lap, track_to_track, truth
from coopsim.agents.boxes import AB3DMOTTracking, LateFusion
from coopsim.agents.policy import Needs, Policy
from coopsim.agents.tracking_policy import TrackingPolicy
from coopsim.support.lazy_names import lazy_names
from coopsim.support.moved import moved

if TYPE_CHECKING:
    from coopsim.agents.learned_fusion import LearnedFusion
    from coopsim.agents.opencood_network import OpenCoodNetwork
    from coopsim.agents.perceiving_policy import PerceivingPolicy

__all__ = [
    "AB3DMOTTracking",
    "LateFusion",
    "LearnedFusion",
    "Needs",
    "OpenCoodNetwork",
    "PerceivingPolicy",
    "Policy",
    "TrackingPolicy",
    "boxes",
    "coop_fuse",
    "graph_lap",
    "track_to_track",
    "truth",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "LearnedFusion": "coopsim.agents.learned_fusion",
        "OpenCoodNetwork": "coopsim.agents.opencood_network",
        "PerceivingPolicy": "coopsim.agents.perceiving_policy",
    },
)

for _old in ("ab3dmot_policy", "late_fusion"):
    moved(f"{__name__}.{_old}", "coopsim.agents.boxes")
