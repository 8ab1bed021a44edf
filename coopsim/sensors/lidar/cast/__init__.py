"""Casting a LiDAR's rays."""
