"""Recorded worlds: the same traffic for every policy.

A world's actors and agents go into a file frame by frame, to the last bit, and come out again as a world that is
played. Start in `recorded_world.py`; `episode_file.py` is the format.
"""
