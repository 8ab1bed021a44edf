"""Driving by planners: each driven car's acceleration and steering, from the tracks that were reported for it."""

from __future__ import annotations

import math
import reprlib
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from coopsim.comms.received_intents import ReceivedIntents
from coopsim.envs.frames import AgentFrame, Frame
from coopsim.envs.simulated.occlusion_map import OcclusionMap
from coopsim.errors import InvalidValueError, PlannerError
from coopsim.interfaces.planner import Plan, PlannedCar, Planner, PlannerOption, make_planner
from coopsim.types import NS_PER_S, AgentSpec, Observation, Tracks
from coopsim.types.driving import LARGEST_ACCELERATION_M_S2, LARGEST_BRAKING_M_S2, LARGEST_STEERING_RAD

LONGEST_CALL_S = 5.0
"""Time after which a planner's answer is refused; a step is a tenth of a second, and planners take milliseconds."""


class PlannedDriving:
    """The planners of an episode, one for each driven car; without `occlusions` they know no hiding places."""

    def __init__(
        self, planner: PlannerOption, driven: Mapping[str, AgentSpec], occlusions: OcclusionMap | None = None
    ) -> None:
        self._specs, self._occlusions = driven, occlusions
        self._planners = {name: make_planner(planner) for name in driven}
        self._aware = {name for name, each in self._planners.items() if each.occlusion_aware}
        self._intents = {name: ReceivedIntents() for name in driven}

    def hear(self, received: Mapping[str, Observation]) -> None:
        """Take notice of what arrived at the driven cars, by name."""
        if self._occlusions is not None:
            self._occlusions.hear({name: received[name] for name in self._aware if name in received})
        for name, intents in self._intents.items():
            if name in received:
                intents.hear(received[name])

    def commands(self, frame: Frame, tracks: Mapping[str, Tracks]) -> dict[str, Plan]:
        """Ask the planner of each driven car that has not crashed for an acceleration, m/s², or with an angle, rad.

        Args:
            frame: the frame that is over.
            tracks: tracks that the agents reported for it, in their base frames.

        Raises:
            PlannerError: a planner raised, took too long, or returned no finite numbers.
        """
        return {
            name: self._ask(name, frame.time_ns, agent, tracks[name])
            for name, agent in frame.agents.items()
            if name in self._planners and agent.car is not None and not agent.car.crashed
        }

    def _ask(self, name: str, time_ns: int, agent: AgentFrame, tracks: Tracks) -> Plan:
        state, hiding = agent.car, self._occlusions if name in self._aware else None
        assert state is not None
        car = PlannedCar(
            name,
            time_ns,
            self._specs[name].dt_s,
            tracks,
            state.speed_m_s,
            state.acceleration_m_s2,
            float(agent.observation.odometry.xyz_yaw[3]),
            state.length_m,
            state.width_m,
            state.route,
            state.traffic_side,
            state.steering_rad,
            state.wheelbase_m,
            self._intents[name].now(agent.observation),
            None if hiding is None else hiding.of(name, agent.observation.pose.xyz_yaw),
        )
        planner, began = self._planners[name], time.monotonic()
        try:
            answer: object = planner.plan(car)
        except Exception as error:  # a user's class may raise anything
            raise _error(planner, car, f"raised {type(error).__name__}: {error}") from error
        taken_s = time.monotonic() - began
        if taken_s > LONGEST_CALL_S:
            raise _error(planner, car, f"took {taken_s:.1f} s; accepted: at most {LONGEST_CALL_S:g} s")
        return _checked(planner, car, answer)


def _checked(planner: Planner, car: PlannedCar, answer: Any) -> Plan:
    pair = answer if planner.steers and isinstance(answer, (tuple, list)) and len(answer) == 2 else (answer, 0.0)
    if _is_finite(pair[0]) and _is_finite(pair[1]) and planner.steers == (pair is answer):
        acceleration = float(min(max(pair[0], -LARGEST_BRAKING_M_S2), LARGEST_ACCELERATION_M_S2))
        angle = float(min(max(pair[1], -LARGEST_STEERING_RAD), LARGEST_STEERING_RAD))
        return (acceleration, angle) if planner.steers else acceleration
    accepted = "a finite acceleration in m/s²" + " and a finite angle in rad" * planner.steers
    raise _error(planner, car, f"returned {_shown(answer)}; accepted: {accepted}")


def _is_finite(number: Any) -> bool:
    if isinstance(number, (int, float, np.integer, np.floating)) and not isinstance(number, bool):
        with suppress(OverflowError):  # of an integer that is no float
            return math.isfinite(number)
    return False


def _shown(answer: Any) -> str:
    try:
        return reprlib.repr(answer)
    except Exception:  # of an integer of more digits than Python prints, or of a user's class
        return f"an object of {type(answer).__name__}"


def _error(planner: Planner, car: PlannedCar, what: str) -> PlannerError:
    return PlannerError(f"planner {type(planner).__name__} of {car.name} at {car.time_ns / NS_PER_S:.2f} s {what}")


def require_planner(planner: PlannerOption) -> bool:
    """Make a planner once, so that a wrong option is refused before an episode begins; return whether it steers.

    Raises:
        CoopsimError: the planner is unknown or is no planner.
    """
    made: object = make_planner(planner)
    if not isinstance(made, Planner):
        raise InvalidValueError(f"planner must make a coopsim.interfaces.planner.Planner, got {made!r}")
    return made.steers
