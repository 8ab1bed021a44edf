"""The attacks that come along. Importing registers them."""

from coopsim.attacks import envelopes, ghost, gradients, objects, points, senders

__all__ = ["envelopes", "ghost", "gradients", "objects", "points", "senders"]
