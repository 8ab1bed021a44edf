"""The attacks that come along. Importing registers them."""

from coopsim.attacks import brakes, envelopes, ghost, gradients, objects, points, senders

__all__ = ["brakes", "envelopes", "ghost", "gradients", "objects", "points", "senders"]
