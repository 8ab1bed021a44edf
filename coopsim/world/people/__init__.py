"""People on foot and on two wheels.

A graph of ways and numbers by class become positions and headings, step by step, among the vehicles of a fleet. Start
in `people.py`; `walking.py` has its kernels.
"""
