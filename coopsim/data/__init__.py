"""Recorded data, converted to our frames and orders at this edge only."""
