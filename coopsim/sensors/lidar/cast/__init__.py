"""Casting the rays of a spinning LiDAR."""
