"""Cars that an agent steers: actuators, the kinematic bicycle, and the grip of tyres.

The reference point is the middle of the body, halfway between the axles (Polack et al., "The kinematic bicycle model:
a consistent model for planning feasible trajectories for autonomous vehicles?", IEEE Intelligent Vehicles Symposium
2017). Within a step acceleration and angle are constant, and the path is an exact arc. Tyres slide where acceleration
and curvature ask for more than friction gives: they keep to its circle, braking first, so the car goes wide.
"""

from __future__ import annotations

import math
from typing import Any

from coopsim.support.kernels import njit
from coopsim.types.driving import JERK_M_S3
from coopsim.world.traffic.fleet import Vehicle
from coopsim.world.traffic.lane_geometry import distance_to_box, heading_at, local_coordinates
from coopsim.world.traffic.lanes import LaneArrays
from coopsim.world.traffic.rules import SAME_WAY

STEERING_RAD_S = 0.4
"""Fastest turn of the front wheels: all vehicles of CommonRoad (Althoff, Koschi and Manzinger, "CommonRoad: Composable
benchmarks for motion planning on roads", IEEE Intelligent Vehicles Symposium 2017; vehicle models)."""

STEERING_LAG_S = 0.27
"""Time constant with which the front wheels follow their command: Autoware's `simple_planning_simulator`."""

WHEELBASE = 0.57
"""Share of a car's length between its axles: 2.58 m of 4.51 m, CommonRoad's BMW 320i."""

DRY, WET = 0.85, 0.6
"""Coefficients of friction on asphalt, dry and under a film of water: Wong, "Theory of Ground Vehicles", in the middle
of .8 to .9 and of .5 to .7. Hard-packed snow has .2 there, and ice .1."""

_GRAVITY_M_S2 = 9.81


def actuate(row: Any, acceleration_m_s2: float, angle_rad: float, dt_s: float) -> None:
    """Let brakes, engine and front wheels of a steered car follow its command for `dt_s`."""
    change_m_s2, before = JERK_M_S3 * dt_s, float(row["acceleration"])
    row["acceleration"] = before + min(max(acceleration_m_s2 - before, -change_m_s2), change_m_s2)
    wanted, most = (angle_rad - float(row["wheel"])) * -math.expm1(-dt_s / STEERING_LAG_S), STEERING_RAD_S * dt_s
    row["wheel"] += min(max(wanted, -most), most)


@njit(cache=True, nogil=True)
def roll(vehicle: Vehicle, dt_s: float) -> None:
    """Move a steered car for `dt_s` along an arc, as far as its tyres grip; it does not drive backwards."""
    most = vehicle.grip * _GRAVITY_M_S2
    acceleration = min(max(vehicle.acceleration, -most), most)
    before, after = vehicle.speed, max(vehicle.speed + acceleration * dt_s, 0.0)
    rolling_s = dt_s if after > 0.0 or acceleration >= 0.0 else before / -acceleration
    way_m = (before + after) / 2 * rolling_s
    curvature = math.sin(math.atan(math.tan(vehicle.wheel) / 2)) / vehicle.axle_m
    held = math.sqrt(max(most * most - acceleration * acceleration, 0.0)) / max(before * before, 1e-6)
    curvature = min(max(curvature, -held), held)
    slip, half_turn = math.asin(curvature * vehicle.axle_m), curvature * way_m / 2
    chord_m = way_m * (math.sin(half_turn) / half_turn if abs(half_turn) > 1e-9 else 1.0)
    vehicle.x += chord_m * math.cos(vehicle.heading + slip + half_turn)
    vehicle.y += chord_m * math.sin(vehicle.heading + slip + half_turn)
    vehicle.heading += 2 * half_turn
    vehicle.steering = math.atan(2 * math.tan(slip))
    vehicle.speed, vehicle.acceleration = after, (after - before) / dt_s


@njit(cache=True, nogil=True)
def is_on_lane(network: LaneArrays, vehicle: Vehicle, number: int) -> bool:
    """Return whether the middle of a car is on a lane that leads where it is headed."""
    lane = network.lanes[number]
    along, aside = local_coordinates(lane, network.corners, vehicle.x, vehicle.y)
    turned = math.cos(vehicle.heading - heading_at(lane, network.corners, along))
    return bool(abs(aside) <= lane.width / 2 and 0.0 <= along <= lane.length and turned > SAME_WAY)


@njit(cache=True, nogil=True)
def is_against(network: LaneArrays, vehicle: Vehicle) -> bool:
    """Return whether the middle of a car is on lanes, and all of them lead the other way."""
    against = False
    for number in range(len(network.lanes)):
        lane = network.lanes[number]
        if distance_to_box(lane, vehicle.x, vehicle.y) > lane.width / 2:
            continue
        along, aside = local_coordinates(lane, network.corners, vehicle.x, vehicle.y)
        if abs(aside) <= lane.width / 2 and 0.0 <= along <= lane.length:
            turned = math.cos(vehicle.heading - heading_at(lane, network.corners, along))
            if turned > -SAME_WAY:
                return False
            against = True
    return against
