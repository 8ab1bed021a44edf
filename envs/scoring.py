"""Rewards, and the picture of the frame that was scored last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.envs.frames import AgentFrame, Frame, world_points
from coopsim.envs.message_gain import MessageGain, MessageGains
from coopsim.envs.rewards import WHOLE, DriveReward, DriveStep, Reward, RewardOption, make_reward
from coopsim.episode import Episode, Recorder
from coopsim.errors import InvalidValueError
from coopsim.metrics.evaluator import FrameCounts
from coopsim.types import AgentSpec, Observation, Tracks
from coopsim.types.lies import Lie
from coopsim.viz.bev import BevFrame, BevRenderer
from coopsim.world.snapshot import RoadMap

Parts = dict[str, float]
"""Parts of a reward by name; their `total` is the reward, 0 without parts."""


class Rewards:
    """Rewards of the steps of agents.

    Attributes:
        is_default: no reward was asked for.

    Args:
        reward: the option `reward`.
        dt_s: duration of a step.
        drives: there are agents whose frames have the state of a driven car.
        specs: specs of the agents.

    Raises:
        UnknownNameError, InvalidValueError: the reward is not accepted, or is of drives and there are none.
        PolicyMismatchError: the reward is of messages, and its receiver cannot read those that are sent.
    """

    def __init__(self, reward: RewardOption, dt_s: float, *, drives: bool, specs: Mapping[str, AgentSpec]) -> None:
        self._reward, self._dt_s = make_reward(reward), dt_s
        self.is_default = reward is None
        self._gains: MessageGains | None = None  # of the running episode, if the reward is of messages
        self._gained: Mapping[str, float] = {}  # by messages, of the step to the frame that was heard last
        if isinstance(self._reward, MessageGain):
            self._reward.make_receiver().require(specs)
        drives_needed = isinstance(self._reward, MessageGain) and self._reward.metric == "braking"
        if (isinstance(self._reward, DriveReward) or drives_needed) and not drives:
            raise InvalidValueError(
                f"reward {reward!r} is of driven cars: it needs a simulation with "
                'control="acceleration", "policy" or "planner" and traffic="arrays"'
            )

    def begin(
        self, specs: Mapping[str, AgentSpec], match_iou: float, region_m: tuple[float, float] | None, seed: int
    ) -> None:
        """Begin an episode."""
        if isinstance(self._reward, MessageGain):
            self._gains = MessageGains(self._reward, specs, match_iou, region_m, seed)

    def hear(
        self, frame: Frame, received: Mapping[str, Observation], sent_bytes: Callable[[], Mapping[str, int]]
    ) -> None:
        """Take in a frame's observations with their inboxes, and the bytes that agents sent."""
        if self._gains is not None:
            self._gained = self._gains.step(frame, received, sent_bytes())

    def of_step(self, counts: Mapping[str, FrameCounts], before: Frame, after: Frame) -> dict[str, Parts]:
        """Return the parts of the rewards of the step between two frames, by the agents that have counts."""
        parts = {name: self._of(each, before.agents[name], after.agents.get(name)) for name, each in counts.items()}
        return parts | {name: {WHOLE: value} for name, value in self._gained.items() if name in parts}

    def _of(self, counts: FrameCounts, before: AgentFrame, after: AgentFrame | None) -> Parts:
        """Return the parts of the reward of an agent's step between two frames; in the second it may be gone."""
        if isinstance(self._reward, MessageGain):
            return {}  # an agent that is gone; `_gained` tells the others'
        if isinstance(self._reward, Reward):
            return {WHOLE: self._reward(counts)}
        if before.car is None or after is None or after.car is None:
            return {}
        moved = before.body.world_SE3_base.inverse().apply(after.body.world_SE3_base.translation)[:2]
        return self._reward.parts(DriveStep(counts, self._dt_s, before.car, after.car, moved))


class ScoredView(Recorder):
    """The frame that was scored last, and the tracks that were reported for it.

    `all_tracks`: pictures show the tracks of all agents, not of the ego alone.
    """

    def __init__(self, all_tracks: bool = False) -> None:
        self._all_tracks = all_tracks
        self._renderer: BevRenderer | None = None
        self._road_map: RoadMap
        self._frame: Frame
        self._tracks: Mapping[str, Tracks]
        self._lies: Sequence[Lie] = ()

    def begin(self, episode: Episode) -> None:
        """Begin an episode: take over the outlines of its place and its first frame, for which nothing is reported."""
        self._road_map = episode.env.road_map
        self._frame, self._tracks, self._lies = episode.frame.without_probe(), {}, ()

    def on_report(self, episode: Episode) -> None:
        """Take over a frame, the tracks reported for it, and the lies in its messages."""
        self._frame, self._tracks, self._lies = episode.frame.without_probe(), episode.tracks, episode.lies

    def bev_frame(self, *, points: bool, agent: str | None = None, ego: str | None = None) -> BevFrame:
        """Return the frame with its tracks, in the world frame; it is about the `ego`, by default the first driven car.

        `points` adds those of all sweeps, or of those of one `agent`.
        """
        bodies = {name: agent.body for name, agent in self._frame.agents.items()}
        placed = {name: tracks.transform(bodies[name].world_SE3_base) for name, tracks in self._tracks.items()}
        cloud = world_points(self._frame, agent) if points else np.zeros((0, 3))
        if ego is None:
            ego = next((name for name, each in self._frame.agents.items() if each.car is not None), None)
        return BevFrame(self._frame.time_ns, self._frame.actors, bodies, cloud, placed, self._lies, ego)

    def render(self, mode: str, ego: str | None = None) -> NDArray[np.uint8] | None:
        """Return a picture (H, W, 3) for the mode "rgb_array"; show it in a window for "human"."""
        if self._renderer is None:
            self._renderer = BevRenderer(self._road_map, all_tracks=self._all_tracks)
        self._renderer.show_map(self._road_map)
        frame = self.bev_frame(points=True, ego=ego)
        return self._renderer.render(frame, mode)

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
