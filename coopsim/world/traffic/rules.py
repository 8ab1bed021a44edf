"""Rules of driving that the array engine and the highway-env engine share, as scalar functions.

Compiled, so that kernels can call them. Angles are in rad, places across a lane ("aside") in m to its left.
"""

from __future__ import annotations

import math

import numpy as np

from coopsim.support.kernels import njit

VEHICLE_LENGTH_M = 5.0
"""Length of highway-env's usual vehicle: lanes extend by it beyond their ends; drivers leave them half of it early."""

COMFORT_ACC_MAX = 3.0
"""IDM's acceleration on a free road from standstill, m/s2."""

STEERING_MAX_RAD = math.pi / 3

LOOK_AHEAD_M = 60.0
"""Distance along the route within which drivers in town see others."""

NEAR_M = 4.0
"""Bodies up to this far outside a lane are considered, so that people are seen before they step into it."""

MERGE_M = 30.0
"""A driver on the highway does not change to a lane that another vehicle within this distance is about to enter."""

PARKED_ASIDE_M = 0.15
"""Largest distance along a bay between a parked vehicle and the bay's middle."""

BESIDE_M = 0.4
"""Vehicles keep behind an obstacle unless this width is left next to it."""

SAME_WAY = 0.5
"""Least cosine between the headings of a vehicle and a lane that it travels along."""

LONG_M = 6.0
"""Longer vehicles leave a lane tail last: the tail is still in it when the middle is not. For shorter ones IDM's gap
is enough."""

STANDING_M_S = 0.5
"""Slower vehicles count as standing."""

EASY_BRAKING_M_S2 = 2.0
"""Braking before bends."""

_STEP_OUT_S = 2.0  # people who will be in the lane by then count as in it


@njit(cache=True, nogil=True)
def wrap(angle: float) -> float:
    """Wrap an angle to [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


@njit(cache=True, nogil=True)
def not_zero(x: float) -> float:
    """Return `x`, moved away from zero to at least a hundredth of its sign."""
    if abs(x) > 1e-2:
        return x
    return 1e-2 if x >= 0 else -1e-2


@njit(cache=True, nogil=True)
def draw_turn(key: int, count: int, ways: int) -> int:
    """Return the `count`-th turn in [0, ways) of the vehicle with key `key`.

    A hash (SplitMix64: Steele, Lea and Flood, OOPSLA 2014) and not a stream, so vehicles' turns are independent.
    """
    z = np.uint64(key) + np.uint64(count + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return int((z ^ (z >> np.uint64(31))) % np.uint64(ways))


@njit(cache=True, nogil=True)
def extra_gap(length_m: float, other_length_m: float) -> float:
    """Return what two lengths add to IDM's gap between middles, so that the jam distance holds between bumpers, m."""
    return max(0.0, (length_m + other_length_m) / 2 - VEHICLE_LENGTH_M)


@njit(cache=True, nogil=True)
def interaction(gap_m: float, distance_m: float) -> float:
    """Return IDM's deceleration for a desired gap at a distance, m/s2; none for a negative gap (a faster leader)."""
    return COMFORT_ACC_MAX * (max(gap_m, 0.0) / max(distance_m, 0.1)) ** 2


@njit(cache=True, nogil=True)
def approach_speed(limit_m_s: float, distance_m: float) -> float:
    """Return the speed from which easy braking reaches a lane's limit at its start, m/s."""
    return math.sqrt(limit_m_s**2 + 2 * EASY_BRAKING_M_S2 * max(distance_m, 0.0))


@njit(cache=True, nogil=True)
def without_reversing(acceleration: float, speed: float, dt_s: float) -> float:
    """Limit a braking to what stops the vehicle within a step, m/s2.

    IDM brakes on after the stop: highway-env's vehicles creep backwards in a queue, and steer while they do.
    """
    return max(acceleration, -max(speed, 0.0) / dt_s)


@njit(cache=True, nogil=True)
def angle_to_lane(aside: float, speed: float, lateral_gain: float) -> float:
    """Return the angle to the lane at which to return to its middle line, at most 45 degrees."""
    angle = math.asin(min(max(-lateral_gain * aside / not_zero(speed), -1.0), 1.0))
    return min(max(angle, -math.pi / 4), math.pi / 4)


@njit(cache=True, nogil=True)
def steer_front_axle(aside: float, lane_heading: float, heading: float, speed: float, lateral_gain: float) -> float:
    """Return the steering angle that leads the front axle along the lane under it, and towards its middle line.

    Hoffmann et al., "Autonomous automobile trajectory tracking for off-road driving", American Control Conference 2007,
    with highway-env's gain and limits.
    """
    angle = wrap(lane_heading + angle_to_lane(aside, speed, lateral_gain) - heading)
    return min(max(angle, -STEERING_MAX_RAD), STEERING_MAX_RAD)


@njit(cache=True, nogil=True)
def swing_m(length_m: float, axle_m: float, radius_m: float) -> float:
    """Return how far a long vehicle's front swings outside the way of its front axle in a bend.

    Up to the second order in the length, a slight overestimate. With the axles at its ends (`Vehicle.axle_m`) a vehicle
    has no front before the axle, and this is 0.
    """
    return ((length_m / 2 + axle_m) ** 2 - (2 * axle_m) ** 2) / (2 * radius_m)


@njit(cache=True, nogil=True)
def passing_distance(width_m: float, other_width_m: float) -> float:
    """Return the distance aside within which two bodies leave too little room to pass."""
    return (width_m + other_width_m) / 2 + BESIDE_M


@njit(cache=True, nogil=True)
def is_vehicle_in_way(
    aside: float, angle: float, length_m: float, width_m: float, stands: bool, reach_m: float, swing: float
) -> bool:
    """Return whether a driver must stay behind another vehicle on its route.

    It must if the other goes the same way (crossing vehicles are the junction's business), or stands (or is wrecked)
    with its ends in the lane. A driver that swings out also stays behind vehicles of its direction on the outside, but
    not beside oncoming ones: the two would wait for each other.

    All arguments are the other's but `reach_m` (see `passing_distance`) and `swing`, the driver's swing on the lane.
    """
    same_way = math.cos(angle) > SAME_WAY
    if same_way:
        reach_m += swing
    if stands:
        across = abs(math.cos(angle)) * width_m + abs(math.sin(angle)) * length_m
        return abs(aside) < reach_m + (across - width_m) / 2
    return abs(aside) < reach_m and same_way


@njit(cache=True, nogil=True)
def is_person_in_way(aside: float, angle: float, speed: float, reach_m: float) -> bool:
    """Return whether a person is in the lane within `reach_m` of its middle, or about to step there."""
    soon = aside + speed * math.sin(angle) * _STEP_OUT_S
    return min(aside, soon) < reach_m and max(aside, soon) > -reach_m


@njit(cache=True, nogil=True)
def cut_inside_m(length_m: float, radius_m: float) -> float:
    """Return how far the rear of a vehicle cuts inside a bend."""
    return length_m**2 / (8 * radius_m)


@njit(cache=True, nogil=True)
def is_tail_in_way(aside: float, angle: float, middle_aside: float, reach_m: float) -> bool:
    """Return whether a vehicle that turns off still has its tail (at `aside`) in the lane, but no longer its middle."""
    return abs(aside) < reach_m and abs(middle_aside) >= reach_m and math.cos(angle) > SAME_WAY
