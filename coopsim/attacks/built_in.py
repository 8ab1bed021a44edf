"""The attacks that come along. Importing registers them."""

from coopsim.attacks import envelopes, features, ghost, objects, points, senders

__all__ = ["envelopes", "features", "ghost", "objects", "points", "senders"]
