"""Planners at the wheel in `coopsim/drive-v1`, to compare a learner with on the same routes."""

from __future__ import annotations

import numpy as np

from coopsim.envs.drive.observation import Observed
from coopsim.envs.drive.parallel import DriveParallel
from coopsim.envs.simulated.occlusion_map import OcclusionMap
from coopsim.geometry.se3 import wrap_angle
from coopsim.interfaces.planner import PlannedCar, PlannerOption, make_planner
from coopsim.support.checks import require_choice
from coopsim.types import Tracks, seconds_to_ns, stack_xyz_yaw
from coopsim.types.driving import (
    LARGEST_ACCELERATION_M_S2,
    LARGEST_BRAKING_M_S2,
    LARGEST_STEERING_RAD,
    acceleration_of,
)

SEEN_M = 100.0
"""Distance up to which a planner is told of road users."""


class PlannedDriver:
    """Planner of one car for the running episode; one that does not steer is steered by pure pursuit.

    It is told of road users up to `SEEN_M` away as they are, as a learner is of the nearest ones. One that is aware of
    occlusions gets walls and entries of the map; no other agent says what it sees.

    Args:
        env: the environment, after `reset`.
        planner: a planner or its label, as the option `planner` of environments.
        name: the car.

    Raises:
        UnknownNameError, InvalidValueError: there is no such planner or car.
    """

    def __init__(self, env: DriveParallel, planner: PlannerOption, name: str = "cav_0") -> None:
        require_choice("car", name, env.possible_agents)
        self._env, self._planner, self._name = env, make_planner(planner), name
        self._time_s = 0.0
        self._heading: float | None = None
        aware = self._planner.occlusion_aware
        self._occlusions = OcclusionMap(env.world.map, env.world.entries) if aware else None

    def act(self) -> Observed:
        """Return the action for the present state; to be asked once a step."""
        world, dt_s = self._env.world, self._env.dt_s
        car, body, actors = world.car_ahead(self._name), world.agents()[self._name], world.actors()
        pose = stack_xyz_yaw(body.world_SE3_base)
        heading = float(pose[3])
        turned = 0.0 if self._heading is None else float(wrap_angle(np.array(heading - self._heading)))
        near = np.hypot(*(actors.boxes.center[:, :2] - pose[:2]).T) < SEEN_M
        others = actors[np.flatnonzero(near & (actors.id != body.actor_id))].transform(body.world_SE3_base.inverse())
        tracks = Tracks(others.id, others.boxes, others.velocity, np.ones(len(others)), others.label)
        told = PlannedCar(
            self._name,
            seconds_to_ns(self._time_s),
            dt_s,
            tracks,
            car.speed_m_s,
            car.acceleration_m_s2,
            turned,
            car.length_m,
            car.width_m,
            car.route,
            car.traffic_side,
            car.steering_rad,
            car.wheelbase_m,
            occlusions=None if self._occlusions is None else self._occlusions.of(self._name, pose),
        )
        plan, self._heading, self._time_s = self._planner.plan(told), heading, self._time_s + dt_s
        angle = plan[1] if isinstance(plan, tuple) else car.route.pursuit_rad(car.speed_m_s, car.wheelbase_m)
        acceleration = min(max(acceleration_of(plan), -LARGEST_BRAKING_M_S2), LARGEST_ACCELERATION_M_S2)
        return np.array([acceleration, min(max(angle, -LARGEST_STEERING_RAD), LARGEST_STEERING_RAD)], np.float32)
