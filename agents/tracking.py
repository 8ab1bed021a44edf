"""The shape that tracking-by-detection policies share: gather detections, track them, report."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field

import numpy as np

from coopsim.agents.base import Policy
from coopsim.geometry.se3 import SE3
from coopsim.tracking.tracker import Tracker
from coopsim.types import AgentSpec, Detections, Observation, Tracks


@dataclass
class _AgentState:
    tracker: Tracker
    odom_SE3_base: SE3 = field(default_factory=SE3.identity)


class TrackingPolicy(Policy):
    """Tracks what `gather` finds, with one tracker per agent.

    Tracks are kept in the odometry frame, in which still things stand still and whose drift is slow, so that
    noise of the global pose reaches a track only through what other agents said.
    """

    def __init__(self) -> None:
        self._states: dict[str, _AgentState] = {}

    @abstractmethod
    def make_tracker(self) -> Tracker:
        """A new tracker, for one agent and one episode."""

    def gather(self, observation: Observation) -> Detections:
        """What is to be tracked in this frame, in the agent's base frame; its own detections by default."""
        return observation.detections

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._states[spec.name] = _AgentState(self.make_tracker())

    def track(self, agent: str, observation: Observation) -> Tracks:
        state = self._states[agent]
        state.odom_SE3_base = state.odom_SE3_base.compose(observation.odometry.previous_SE3_current)
        found = self.gather(observation).transform(state.odom_SE3_base)
        tracks = state.tracker.step(found, observation.time_ns)
        return tracks.transform(state.odom_SE3_base.inverse())
