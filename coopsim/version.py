"""The version of coopsim."""

__version__ = "0.1.0"
