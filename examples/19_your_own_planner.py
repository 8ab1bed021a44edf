"""Plug in a custom planner with one method: it is given what its car knows, and says how to accelerate."""

import numpy as np

import coopsim
from coopsim.planning import PLANNERS
from coopsim.testing import check_planner


@PLANNERS.register("careful")
class Careful(coopsim.Planner):
    """Keep below the limit, and stop 5 m before the first track on the way."""

    def plan(self, car: coopsim.PlannedCar) -> float:
        along, aside, _ = car.route.place(car.tracks.boxes.center[:, :2])
        half_m = car.tracks.boxes.size[:, 0] / 2
        in_way = (np.abs(aside) < half_m + car.width_m / 2) & (along > 0)
        gap_m = float((along - half_m)[in_way].min(initial=100.0)) - car.length_m / 2 - 5.0
        most = min(float(car.route.speed_limit_m_s[0]), np.sqrt(2 * 2.0 * max(gap_m, 0.0)))  # stops at 2 m/s²
        return float(most - car.speed_m_s) / 0.5


check_planner("careful")
for planner in ("careful", "idm_aeb"):
    score = coopsim.evaluate(
        "late_fusion", "crossing", seed=1, max_cycles=100, lidar=None, control="planner", planner=planner
    ).score
    print(f"{planner:>8}: {score['progress']:.0f} % of the legal way, {score['hard_brakes']:.1f} hard brakes")
