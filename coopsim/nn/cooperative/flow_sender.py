"""Sender's half of feature flow: each agent's map before, brought into its present frame, and the derivative."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3, Floats
from coopsim.nn.cooperative.cooperative_net import LONGEST_S, FeatureFlow
from coopsim.nn.cooperative.perceiver import OwnMap
from coopsim.nn.cooperative.warp import warp
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.encoders import stated_place
from coopsim.types import NS_PER_S, FeatureMap, Odometry, SensorView, stack_xyz_yaw

_ROUNDING_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Before:
    """Latest map of an agent, and its motion since.

    Attributes:
        time_ns: time of the map.
        content: the map, without derivative.
        heading_rad: estimated heading of the agent then.
        base_SE3_latest: its base frame at `latest_ns`, in that at `time_ns`.
        latest_ns: time of the last odometry in it.
    """

    time_ns: int
    content: FeatureMap
    heading_rad: float
    base_SE3_latest: SE3
    latest_ns: int

    def moved(self, time_ns: int, odometry: Odometry) -> _Before:
        """Return it after one more frame."""
        base_SE3_latest = self.base_SE3_latest.compose(odometry.previous_SE3_current)
        return replace(self, base_SE3_latest=base_SE3_latest, latest_ns=time_ns)


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """Map of an agent and the one before, with the frame (3,) x m, y m, yaw rad of `now` in that of `before`."""

    now: FeatureMap
    before: FeatureMap
    before_SE2_now: Floats
    interval_s: float


class FlowSender:
    """Add derivatives to the maps that agents send.

    A first map is sent without; so is one whose time is not later than the last one's, which is of another episode, or
    one long after it.
    """

    def __init__(self, flow: FeatureFlow, backend: Backend = PROCESSOR) -> None:
        self._flow, self._backend = backend.place(flow), backend
        self._before: dict[str, _Before] = {}

    def follow(self, agent: str, time_ns: int, odometry: Odometry) -> None:
        """Take in the odometry of a frame without sensor data, in which no map is made."""
        before = self._before.get(agent)
        if before is not None and time_ns > before.latest_ns:
            self._before[agent] = before.moved(time_ns, odometry)

    def add(self, views: Mapping[str, SensorView], maps: Mapping[str, OwnMap]) -> dict[str, OwnMap]:
        """Return agents' maps with derivatives in their messages; to be called once in each frame, in order."""
        known = {agent: steps for agent, view in views.items() if (steps := self._step(view, maps[agent])) is not None}
        changes = dict(zip(known, self._backend.map(self._changes, list(known.values())), strict=True))
        made = {agent: _with_change(maps[agent], changes.get(agent)) for agent in views}
        for agent, view in views.items():
            still = SE3.identity()
            self._before[agent] = _Before(view.time_ns, maps[agent].message, stated_place(view)[0], still, view.time_ns)
        return made

    def _step(self, view: SensorView, own: OwnMap) -> _Step | None:
        """Return an agent's map and the one before; None: nothing is known of how it changes."""
        before = self._before.get(view.agent)
        if before is None or not 0 < view.time_ns - before.time_ns <= (LONGEST_S + _ROUNDING_S) * NS_PER_S:
            return None
        before_SE2_now = _before_SE2_now(before.moved(view.time_ns, view.odometry), view)
        return _Step(own.message, before.content, before_SE2_now, (view.time_ns - before.time_ns) / NS_PER_S)

    def _changes(self, steps: Sequence[_Step]) -> list[NDArray[np.float32]]:
        """Return how the map of each agent changes, (C, h, w) per second."""
        with self._backend.inference():
            now = self._backend.put(torch.from_numpy(np.stack([step.now.values for step in steps])))
            before = self._backend.put(torch.from_numpy(np.stack([step.before.values for step in steps])))
            placed = [
                warp(before[k : k + 1], step.before.grid, step.now.grid, step.before_SE2_now[None])
                for k, step in enumerate(steps)
            ]
            earlier, known = (torch.cat(each) for each in zip(*placed, strict=True))
            interval_s = self._backend.put(torch.tensor([step.interval_s for step in steps]))
            change = self._flow(now, earlier, known, interval_s)
        return list(change.numpy(force=True))


def _with_change(own: OwnMap, change: NDArray[np.float32] | None) -> OwnMap:
    if change is None:
        return own
    return replace(own, message=replace(own.message, values=np.concatenate([own.message.values, change])))


def _before_SE2_now(before: _Before, view: SensorView) -> Floats:
    """Return an agent's compass frame now in that of before, (3,); by odometry, so without the pose's errors."""
    turned_before = SE3.from_xyz_yaw(np.zeros(3), before.heading_rad)
    turned_back = SE3.from_xyz_yaw(np.zeros(3), -stated_place(view)[0])
    return stack_xyz_yaw(turned_before.compose(before.base_SE3_latest).compose(turned_back))[[0, 1, 3]]
