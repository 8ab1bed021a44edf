"""The attacks that come along. Importing registers them."""

from coopsim.attacks import envelopes, ghost, objects, points, senders

__all__ = ["envelopes", "ghost", "objects", "points", "senders"]
