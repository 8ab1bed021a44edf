"""Cooperative-perception policies, one short file per documented method. Importing registers them."""

from coopsim.agents import (
    ab3dmot_policy,
    coop_fuse,
    dino_codt_tracking,
    graph_lap,
    late_fusion,
    sequential_kf,
    track_to_track,
    vic_fscm_association,
    yoloo_geometry,
)
from coopsim.agents.policy import Needs, Policy

__all__ = [
    "Needs",
    "Policy",
    "ab3dmot_policy",
    "coop_fuse",
    "dino_codt_tracking",
    "graph_lap",
    "late_fusion",
    "sequential_kf",
    "track_to_track",
    "vic_fscm_association",
    "yoloo_geometry",
]
