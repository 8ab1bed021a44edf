"""Street furniture and plants, which are no objects to be detected.

A layout comes in; the same layout with meshes of furniture goes out, or entries of the key `furniture` of a place.
Reading starts in `furnish.py`; `kinds.py` lists all kinds and how many of each streets have.
"""
