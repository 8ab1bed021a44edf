"""Typed structs as the dicts of arrays that PettingZoo's spaces describe, and back."""
