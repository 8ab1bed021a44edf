"""LiDAR: beams, sweeps, returns."""
