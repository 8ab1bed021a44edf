"""Towns that are drawn from a seed.

A seed and `TownOptions` come in; a `Scenario` goes out, whose place can also be written as a scenario file. Reading
starts in `town.py`, which calls the other files in this order: a sketch of straight links, a plan of streets and
junctions, roads and starts, then kerbs, pavements, roadside, and buildings on lots. `scenarios.py` adds traffic.
"""

from coopsim.support.moved import moved

moved(f"{__name__}.options", "coopsim.world.drawn_options")
