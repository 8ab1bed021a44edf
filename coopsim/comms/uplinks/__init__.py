"""Uplinks: the content that agents share of their observations. Importing registers them.

Input is an agent's `Observation`, output its `Message`. Start with `uplink.py`; each `share_*.py` has one kind.
"""

from coopsim.comms.uplinks import (
    by_action,
    in_turn,
    share_detections,
    share_features,
    share_intents,
    share_points,
    share_tracks,
)

__all__ = [
    "by_action",
    "in_turn",
    "share_detections",
    "share_features",
    "share_intents",
    "share_points",
    "share_tracks",
]
