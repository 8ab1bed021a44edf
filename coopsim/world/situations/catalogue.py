"""The situations that come with coopsim, which importing this module registers."""

from coopsim.world.situations import crossings, pedestrians

__all__ = ["crossings", "pedestrians"]
