"""The simulated world: places, traffic, people, and recordings of them.

A `Scenario` (a place and its population) and a seed make a `World`, whose actors and agents change step by step, and
whose static meshes and road map do not. Start in `world.py`, then `scenario.py`; `snapshot.py` has the structs.
"""
