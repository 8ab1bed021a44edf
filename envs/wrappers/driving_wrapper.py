"""Driving and Speaking: agents choose commands or messages alone, and a policy reports their tracks."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from coopsim.agents.policy import Policy
from coopsim.envs.rewards import warn_of_tracking_reward
from coopsim.envs.wrappers.base_wrappers import ByAgent
from coopsim.envs.wrappers.message_numbers import as_message, numbers_of
from coopsim.envs.wrappers.tracked_by_policy import TrackedByPolicy
from coopsim.errors import CoopsimError, InvalidActionError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers, require_finite
from coopsim.types import AgentSpec
from coopsim.wire.actions import MESSAGE, command_space


class Driving(TrackedByPolicy):
    """The parallel environment for learners that drive: an action is a command alone.

    It is one of `MANEUVERS`, `Discrete(5)`, or under `control="acceleration"` in m/s², `Box(-8, 3, (1,))`; under
    `control="steering"` with an angle in rad, a `Box` (2,).

    A policy reports the tracks of all agents. Those that do not drive (roadside units, drones) are left to it, and are
    not among the agents of this environment. A single-agent environment has `tracker=` for the same.

    Args:
        env: made with `control="policy"` or "acceleration"; its observations and actions are coopsim's own.
        tracker: the policy, by name or spec ("late_fusion(merge_iou=0.2)") or itself, of which a copy is made. What it
            needs of the environment, as another uplink than "detections", the environment was made with.

    Raises:
        InvalidValueError: `env` is no such environment, no agent drives, or `tracker` is no policy.
        UnknownNameError: no policy has that name.
        PolicyMismatchError: the environment lacks what the policy needs.
    """

    _kind = "command"
    _needed = 'drive: make a simulation with control="policy" or "acceleration"'

    def __init__(self, env: ParallelEnv[str, Any, Any], tracker: str | Policy = "late_fusion") -> None:
        super().__init__(env, tracker)
        if self._cooperative.has_default_reward:
            warn_of_tracking_reward()

    def _chooses(self, spec: AgentSpec) -> bool:
        return spec.command is not None

    def _space(self, spec: AgentSpec) -> spaces.Space[Any]:
        return command_space(str(spec.command))

    def _part(self, spec: AgentSpec, action: Any) -> ByAgent:
        # Some learners give an array of no dimension; the environment checks the rest.
        number = action[()] if isinstance(action, np.ndarray) and action.ndim == 0 else action
        return {str(spec.command): number}


class Speaking(TrackedByPolicy):
    """The parallel environment for learners of messages: an action is a message alone, as numbers in [-1, 1].

    It is one (N,) float32 array, see `coopsim.envs.wrappers.message_numbers`. A policy reports the tracks of all
    agents, and drives those that drive. A single-agent environment has `tracker=` for the same.

    Args:
        env: made with `uplink="action"`, of scores or cells; its observations and actions are coopsim's own.
        tracker: the policy, by name or spec ("late_fusion(merge_iou=0.2)") or itself, of which a copy is made.

    Raises:
        InvalidValueError: `env` is no such environment, or `tracker` is no policy.
        UnknownNameError: no policy has that name.
        PolicyMismatchError: the environment lacks what the policy needs.
    """

    _kind = "message"
    _needed = 'say what they send: make the environment with uplink="action"'

    def _chooses(self, spec: AgentSpec) -> bool:
        return spec.message is not None

    def _space(self, spec: AgentSpec) -> spaces.Space[Any]:
        assert spec.message is not None
        return spaces.Box(-1.0, 1.0, (numbers_of(spec.message),), np.float32)

    def _part(self, spec: AgentSpec, action: Any) -> ByAgent:
        assert spec.message is not None
        try:
            numbers: Floats = as_numbers(action, np.float64, "message")
            require_finite(numbers, "message")
        except CoopsimError as error:
            raise InvalidActionError(f"{spec.name}: {error}") from error
        if numbers.shape != (numbers_of(spec.message),):
            wanted = (numbers_of(spec.message),)
            raise InvalidActionError(f"{spec.name}: message must have shape {wanted}, got {numbers.shape}")
        return {MESSAGE: as_message(np.clip(numbers, -1.0, 1.0), spec.message)}
