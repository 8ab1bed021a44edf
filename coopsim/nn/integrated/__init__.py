"""Integrated detection and tracking: a fused map, what the frame before knew, and two branches that look at both."""
