"""The attacks that come along. Importing registers them."""

from coopsim.attacks import ghost

__all__ = ["ghost"]
