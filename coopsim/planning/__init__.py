"""Planners: from the tracks that a policy reports for a car to the car's acceleration.

In: a `PlannedCar`, which holds what the car has: tracks, its own motion, its route. Out: an acceleration along the
route. Start reading at `planner.py`, the seam; `idm_aeb.py` is the planner that results are reported with.
"""

from coopsim.planning.planner import PLANNERS, PlannedCar, Planner, make_planner

__all__ = ["PLANNERS", "PlannedCar", "Planner", "make_planner"]
