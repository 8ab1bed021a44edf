"""A planner that steers along its route, and brakes and accelerates as `idm_aeb` does.

Pure pursuit: the rear axle goes along the circle that leads to a place ahead on the route (Coulter, "Implementation of
the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from coopsim.interfaces.planner import PLANNERS, PlannedCar
from coopsim.planning.idm_aeb import IdmAeb
from coopsim.support.checks import require_positive
from coopsim.types.driving import LARGEST_STEERING_RAD


@PLANNERS.register("route_follower")
@dataclass(kw_only=True, eq=False)
class RouteFollower(IdmAeb):
    """Steer along the route by pure pursuit; lights, limits, leaders, yielding and emergencies are `IdmAeb`'s.

    Attributes:
        look_s: time to the place that it steers to; ours: less swings with the lag of the wheels, more cuts corners.
        look_m: least distance to that place; ours.
    """

    steers: ClassVar[bool] = True
    look_s: float = 0.6
    look_m: float = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(look_s=self.look_s, look_m=self.look_m)

    def plan(self, car: PlannedCar) -> tuple[float, float]:  # type: ignore[override]  # it steers, too
        ahead_m = max(self.look_s * car.speed_m_s, self.look_m)
        place = min(round(ahead_m / car.route.spacing_m), len(car.route.points) - 1)
        x, y = car.route.points[place].tolist()
        x += car.wheelbase_m / 2  # from the rear axle
        angle = math.atan(2 * y / max(x * x + y * y, 1e-9) * car.wheelbase_m)
        return super().plan(car), min(max(angle, -LARGEST_STEERING_RAD), LARGEST_STEERING_RAD)
