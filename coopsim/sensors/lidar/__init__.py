"""LiDAR: beam tables, sweeps, returns."""
