"""Policies: from each agent's observation to the tracks that it reports.

Read `policy` (the interface), then `tracking_policy` (the base of all that track boxes), then `perceiving_policy` (that
of all with a network). A method of your own stands beside its like in `boxes`, `appearance`, `maps` or `queries`, or in
a file of its own like `coop_fuse`. Importing this package registers all policies.
"""

import sys
import warnings
from types import ModuleType
from typing import Any

from coopsim.agents import (
    appearance,
    boxes,
    coop_fuse,
    early_fusion,
    graph_lap,
    maps,
    queries,
    track_to_track,
    truth,
    vic_integrated,
)
from coopsim.agents.boxes import AB3DMOTTracking, LateFusion
from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.agents.opencood_network import OpenCoodNetwork
from coopsim.agents.perceiving_policy import PerceivingPolicy
from coopsim.agents.policy import Needs, Policy
from coopsim.agents.tracking_policy import TrackingPolicy

__all__ = [
    "AB3DMOTTracking",
    "LateFusion",
    "LearnedFusion",
    "Needs",
    "OpenCoodNetwork",
    "PerceivingPolicy",
    "Policy",
    "TrackingPolicy",
    "appearance",
    "boxes",
    "coop_fuse",
    "early_fusion",
    "graph_lap",
    "maps",
    "queries",
    "track_to_track",
    "truth",
    "vic_integrated",
]


class _OldModule(ModuleType):
    """Old name of a module of policies, for one release."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        value = getattr(boxes, name)
        warnings.warn(f"{self.__name__} is now {boxes.__name__}", DeprecationWarning, stacklevel=2)
        return value


for _old in ("ab3dmot_policy", "late_fusion"):
    sys.modules[f"{__name__}.{_old}"] = _OldModule(f"{__name__}.{_old}")
