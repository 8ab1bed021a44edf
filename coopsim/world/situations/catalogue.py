"""The situations that come with coopsim, which importing this module registers."""

from coopsim.world.situations import crossings, left_turn, merge_barrier, overtaking, pedestrians, queue_end

__all__ = ["crossings", "left_turn", "merge_barrier", "overtaking", "pedestrians", "queue_end"]
