"""Places: `Layout`, the description of a place before anything moves, and the nine that are built in.

A layout has roads, starts, ways of people, meshes and outlines; there is no randomness in it. Start in `layout.py`,
then `crossings.py`; `streets.py` and `scenery.py` are what built-in places are made of.
"""
