"""Images of frames, worlds, models and points, in colours with a meaning.

Input is a frame's truth and tracks, a world, or points; output is arrays (H, W, 3) or a window. Start with `bev.py`.
"""
