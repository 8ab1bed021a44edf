"""The situations that come with coopsim, which importing this module registers."""

from coopsim.world.situations import (
    crossings,
    interactions,
    left_turn,
    merge_barrier,
    overtaking,
    pedestrians,
    queue_end,
    route_drive,
)

__all__ = [
    "crossings",
    "interactions",
    "left_turn",
    "merge_barrier",
    "overtaking",
    "pedestrians",
    "queue_end",
    "route_drive",
]
