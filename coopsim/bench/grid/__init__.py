"""Grid of a benchmark: lists of policies, conditions and seeds go in, as arguments, presets or files; cells come out.

Start at `Grid` in `grid.py`; `cell.py` has the conditions, and the options of the environment that they become.
"""
