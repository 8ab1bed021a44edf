"""Cooperative-perception policies, one short file per documented method. Importing registers them."""

from coopsim.agents import (
    ab3dmot_policy,
    attfuse_policy,
    coop_fuse,
    dino_codt_tracking,
    early_fusion,
    fcooper_policy,
    graph_lap,
    late_fusion,
    pyramid_policy,
    sequential_kf,
    track_to_track,
    vic_fscm_association,
    where2comm_policy,
    yoloo_geometry,
)
from coopsim.agents.policy import Needs, Policy

__all__ = [
    "Needs",
    "Policy",
    "ab3dmot_policy",
    "attfuse_policy",
    "coop_fuse",
    "dino_codt_tracking",
    "early_fusion",
    "fcooper_policy",
    "graph_lap",
    "late_fusion",
    "pyramid_policy",
    "sequential_kf",
    "track_to_track",
    "vic_fscm_association",
    "where2comm_policy",
    "yoloo_geometry",
]
