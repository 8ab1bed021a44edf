"""The sender's half of feature flow: each agent's map before, brought into its present frame, and what changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3, Floats
from coopsim.nn.cooperative.feature_flow import LONGEST_S, FeatureFlow
from coopsim.nn.cooperative.warp import warp
from coopsim.nn.inference.inference import inference, side_by_side
from coopsim.nn.inference.perceiver import OwnMap
from coopsim.types import NS_PER_S, FeatureMap, Odometry, SensorView, stack_xyz_yaw

_ROUNDING_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Before:
    """An agent's latest map, and its motion since.

    Attributes:
        time_ns: of the map.
        content: the map, without change.
        heading_rad: of the agent then, as it was estimated.
        base_SE3_latest: its base frame at `latest_ns`, in that at `time_ns`.
        latest_ns: of the last odometry that is in this.
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


class FlowSender:
    """Adds to the maps that agents send how they change.

    A first map has no change, and is sent without; nor has one whose time is not later than the last one's, which is of
    another episode, or one long after it.

    Args:
        flow: the network.
    """

    def __init__(self, flow: FeatureFlow) -> None:
        self._flow = flow
        self._before: dict[str, _Before] = {}

    def follow(self, agent: str, time_ns: int, odometry: Odometry) -> None:
        """Take in the odometry of a frame without sensor data, in which no map is made."""
        before = self._before.get(agent)
        if before is not None and time_ns > before.latest_ns:
            self._before[agent] = before.moved(time_ns, odometry)

    def add(self, views: Mapping[str, SensorView], maps: Mapping[str, OwnMap], threads: int = 1) -> dict[str, OwnMap]:
        """Return agents' maps with what changes in their messages; to be called once in each frame, in order.

        Args:
            views: what each agent sees.
            maps: what its encoder made of it.
            threads: agents are computed side by side on so many.
        """
        tasks = [partial(self._changing, view, maps[agent]) for agent, view in views.items()]
        made = dict(zip(views, side_by_side(tasks, threads), strict=True))
        for agent, view in views.items():
            still = SE3.identity()
            self._before[agent] = _Before(view.time_ns, maps[agent].message, _heading_rad(view), still, view.time_ns)
        return made

    def _changing(self, view: SensorView, own: OwnMap) -> OwnMap:
        before = self._before.get(view.agent)
        if before is None or not 0 < view.time_ns - before.time_ns <= (LONGEST_S + _ROUNDING_S) * NS_PER_S:
            return own
        before_SE2_now = _before_SE2_now(before.moved(view.time_ns, view.odometry), view)
        change = self.change(own.message, before.content, before_SE2_now, (view.time_ns - before.time_ns) / NS_PER_S)
        message = replace(own.message, values=np.concatenate([own.message.values, change]))
        return replace(own, message=message)

    def change(
        self, now: FeatureMap, before: FeatureMap, before_SE2_now: Floats, interval_s: float
    ) -> NDArray[np.float32]:
        """Return how a map changes, (C, h, w) per second.

        Args:
            now: the map.
            before: the map before.
            before_SE2_now: (3,) x m, y m, yaw rad of the frame of `now` in that of `before`.
            interval_s: time between both.
        """
        with inference():
            earlier, known = warp(torch.tensor(before.values)[None], before.grid, now.grid, before_SE2_now[None])
            change = self._flow(torch.tensor(now.values)[None], earlier, known, torch.tensor([interval_s]))
        found: NDArray[np.float32] = change[0].numpy()
        return found


def _before_SE2_now(before: _Before, view: SensorView) -> Floats:
    """Return an agent's compass frame now in that of before, (3,); by odometry, so without the pose's errors."""
    turned_before = SE3.from_xyz_yaw(np.zeros(3), before.heading_rad)
    turned_back = SE3.from_xyz_yaw(np.zeros(3), -_heading_rad(view))
    return stack_xyz_yaw(turned_before.compose(before.base_SE3_latest).compose(turned_back))[[0, 1, 3]]


def _heading_rad(view: SensorView) -> float:
    return 0.0 if view.pose is None else float(view.pose.xyz_yaw[3])
