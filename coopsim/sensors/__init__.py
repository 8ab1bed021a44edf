"""LiDAR and cameras: what the world looks like from an agent."""
