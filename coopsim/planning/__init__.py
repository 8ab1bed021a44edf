"""Planners: from the tracks that a policy reports for a car to the car's acceleration.

In: a `PlannedCar`, which holds what the car has: tracks, its own motion, its route. Out: an acceleration along the
route. The interface is in `coopsim.interfaces`; `idm_aeb.py` is the planner that results are reported with.
"""

from coopsim.interfaces.planner import PLANNERS, PlannedCar, Planner, make_planner
from coopsim.support.moved import moved

__all__ = ["PLANNERS", "PlannedCar", "Planner", "make_planner"]

moved(f"{__name__}.planner", "coopsim.interfaces.planner")
