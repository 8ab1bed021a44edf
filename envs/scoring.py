"""Rewards, logs of drives, and the picture of the frame that was scored last."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.attacks.attack_option import AttacksOption, attacks_by_agent
from coopsim.envs.frames import AgentFrame, Frame, world_points
from coopsim.envs.message_gain import MessageGain, MessageGains
from coopsim.envs.rewards import DriveReward, DriveStep, Reward, RewardOption, make_reward
from coopsim.errors import InvalidValueError
from coopsim.metrics.deception_log import DeceptionLog
from coopsim.metrics.drive_log import DriveFrame, DriveLog
from coopsim.metrics.evaluator import FrameCounts
from coopsim.types import AgentSpec, Tracks, stack_xyz_yaw
from coopsim.types.lies import Lie
from coopsim.viz.bev import BevFrame, BevRenderer
from coopsim.world.snapshot import RoadMap


class Rewards:
    """Rewards of the steps of agents.

    Args:
        reward: the option `reward`.
        dt_s: duration of a step.
        drives: there are agents whose cars planners or accelerations drive.
        specs: specs of the agents.

    Attributes:
        gains: gains of the running episode's messages; None: the reward is of something else.

    Raises:
        UnknownNameError, InvalidValueError: the reward is not accepted, or is of drives and there are none.
        PolicyMismatchError: the reward is of messages, and its receiver cannot read those that are sent.
    """

    def __init__(self, reward: RewardOption, dt_s: float, *, drives: bool, specs: Mapping[str, AgentSpec]) -> None:
        self._reward, self._dt_s = make_reward(reward), dt_s
        self.gains: MessageGains | None = None
        if isinstance(self._reward, MessageGain):
            self._reward.make_receiver().require(specs)
        drives_needed = isinstance(self._reward, MessageGain) and self._reward.metric == "braking"
        if (isinstance(self._reward, DriveReward) or drives_needed) and not drives:
            raise InvalidValueError(
                f'reward {reward!r} is of driven cars: it needs a simulation with control="acceleration" or "planner"'
            )

    def begin(
        self, specs: Mapping[str, AgentSpec], match_iou: float, region_m: tuple[float, float] | None, seed: int
    ) -> None:
        """Begin an episode."""
        if isinstance(self._reward, MessageGain):
            self.gains = MessageGains(self._reward, specs, match_iou, region_m, seed)

    def of(self, counts: FrameCounts, before: AgentFrame, after: AgentFrame | None) -> float:
        """Return the reward of an agent's step between two frames; in the second it may be gone."""
        if isinstance(self._reward, MessageGain):
            return 0.0  # an agent that is gone; `gains` tells the others'
        if isinstance(self._reward, Reward):
            return self._reward(counts)
        if before.car is None or after is None or after.car is None:
            return 0.0
        moved = before.body.world_SE3_base.inverse().apply(after.body.world_SE3_base.translation)[:2]
        return self._reward(DriveStep(counts, self._dt_s, before.car, after.car, moved))


class DriveRecorder:
    """Logs of the drives of an episode, by driven agent; `conflicts` are ids of actors, see `FrameSource.conflicts`."""

    def __init__(self, frame: Frame, conflicts: tuple[int, ...]) -> None:
        self.logs = {name: DriveLog() for name, agent in frame.agents.items() if agent.car is not None}
        self._conflicts = conflicts

    def update(self, frame: Frame, tracks: Mapping[str, Tracks], after: Frame) -> None:
        """Log a frame with the tracks reported for it; also the frame `after` it if that is the last."""
        self._append(frame, tracks, {name: agent.command_m_s2 for name, agent in after.agents.items()})
        if after.last:
            self._append(after, {}, {})

    def _append(self, frame: Frame, tracks: Mapping[str, Tracks], commands: Mapping[str, float]) -> None:
        for name, log in self.logs.items():
            agent, reported = frame.agents[name], tracks.get(name, Tracks.empty())
            assert agent.car is not None
            pose, command = stack_xyz_yaw(agent.body.world_SE3_base)[[0, 1, 3]], commands.get(name, math.nan)
            log.append(DriveFrame(frame.time_ns, pose, agent.car, agent.truth, reported, command, self._conflicts))


def deception_logs(attacks: AttacksOption, frame: Frame) -> dict[str, DeceptionLog]:
    """Return new logs of the agents that are lied to: of all honest ones, where there is any attack."""
    liars = attacks_by_agent(attacks)
    return {name: DeceptionLog() for name in frame.agents if liars and name not in liars}


def note_lies(
    logs: Mapping[str, DeceptionLog],
    frame: Frame,
    tracks: Mapping[str, Tracks],
    lies: Sequence[Lie],
    region_m: tuple[float, float] | None,
) -> None:
    """Log a frame's lies beside the tracks that honest agents report for it."""
    region = None if region_m is None else np.array(region_m)
    for name, log in logs.items():
        if name in frame.agents:
            agent = frame.agents[name]
            log.append(lies, agent.body.world_SE3_base, agent.truth, tracks[name], region)


class ScoredView:
    """The frame that was scored last, and the tracks that were reported for it."""

    def __init__(self) -> None:
        self._renderer: BevRenderer | None = None
        self._road_map: RoadMap
        self._frame: Frame
        self._tracks: Mapping[str, Tracks]
        self._lies: Sequence[Lie] = ()

    def begin(self, road_map: RoadMap, frame: Frame) -> None:
        """Begin an episode: take over the outlines of its place and its first frame, for which nothing is reported."""
        self._road_map = road_map
        self.update(frame, {}, ())

    def update(self, frame: Frame, tracks: Mapping[str, Tracks], lies: Sequence[Lie]) -> None:
        """Take over a frame, the tracks reported for it, in each agent's base frame, and the lies in its messages."""
        self._frame, self._tracks, self._lies = frame, tracks, lies

    def bev_frame(self, *, points: bool, agent: str | None = None) -> BevFrame:
        """Return the frame with its tracks, in the world frame.

        `points` adds those of all sweeps, or of those of one `agent`.
        """
        bodies = {name: agent.body for name, agent in self._frame.agents.items()}
        placed = {name: tracks.transform(bodies[name].world_SE3_base) for name, tracks in self._tracks.items()}
        cloud = world_points(self._frame, agent) if points else np.zeros((0, 3))
        return BevFrame(self._frame.time_ns, self._frame.actors, bodies, cloud, placed, self._lies)

    def render(self, mode: str) -> NDArray[np.uint8] | None:
        """Return a picture (H, W, 3) for the mode "rgb_array"; show it in a window for "human"."""
        if self._renderer is None:
            self._renderer = BevRenderer(self._road_map)
        self._renderer.show_map(self._road_map)
        frame = self.bev_frame(points=True)
        if mode == "human":
            self._renderer.show(frame)
            return None
        return self._renderer.draw(frame)

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
