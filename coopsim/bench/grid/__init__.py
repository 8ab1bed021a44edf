"""Grid of a benchmark: lists of policies, conditions and seeds go in, as arguments, presets or files; cells come out.

Start at `Grid` in `grid.py`; `axis.py` has the options that vary, with their units; `cell.py` the conditions, and the
options of the environment that they become; `labels.py` their names in tables.
"""
