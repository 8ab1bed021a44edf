"""Targets of the heads, and how far their predictions are from them."""
