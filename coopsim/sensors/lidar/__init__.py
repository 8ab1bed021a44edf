"""Spinning LiDARs: beam tables, rays against triangles, returns with noise, and returns to expect without rays.

Input is a frame's triangles and an agent's pose; output is a `Sweep`. Start with `lidar.py`.
"""
