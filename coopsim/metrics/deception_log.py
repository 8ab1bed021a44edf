"""The log of lies that a receiver was told, and of what it believed: its tracks beside claimed and denied objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.episode import Episode, Recorder
from coopsim.geometry.boxes import Boxes3D, in_region
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types import GroundTruth, Mask, Tracks
from coopsim.types.lies import Lie

NEAR_M = 2.0
"""Distance on the ground within which a track is on an object, as in nuScenes' benchmark of tracking."""


@dataclass(slots=True)
class Deception:
    """A claimed object and one receiver.

    Attributes:
        claimed: number of frames in which it was claimed, inside the receiver's region, where no object is.
        believed: number of these in which a track of the receiver was on it.
        first: number of frames from the first claim to the first such track; inf: there was none.
        longest: largest number of such frames in succession.
    """

    claimed: int = 0
    believed: int = 0
    first: float = math.inf
    longest: int = 0
    _run: int = 0

    def add(self, believed: bool) -> None:
        """Add a frame in which the object was claimed, and the flag of a track on it."""
        if believed and math.isinf(self.first):
            self.first = self.claimed
        self._run = self._run + 1 if believed else 0
        self.claimed, self.believed = self.claimed + 1, self.believed + believed
        self.longest = max(self.longest, self._run)


@dataclass(slots=True)
class DeceptionLog:
    """The lies of others over one episode, as one receiver takes them.

    Attributes:
        ghosts: the claimed objects by attacker, attack and number.
        denied: number of true objects, counted in each frame, that a lie denies and that count for the receiver.
        hidden: number of these on which the receiver has no track.
    """

    ghosts: dict[tuple[str, str, int], Deception] = field(default_factory=dict)
    denied: int = 0
    hidden: int = 0

    def append(
        self, lies: Sequence[Lie], world_SE3_base: SE3, truth: GroundTruth, tracks: Tracks, region_m: Floats | None
    ) -> None:
        """Add a frame: its lies, the receiver's true place, the truth and its tracks in its base frame.

        `region_m` (2,) is half the length and width of the region that counts; None: there is no limit.
        """
        base_SE3_world = world_SE3_base.inverse()
        for lie in lies:
            claimed = lie.claimed.transform(base_SE3_world)
            counts = _inside(claimed, region_m) & ~near(claimed, truth.boxes)
            believed = near(claimed, tracks.boxes)
            for row in np.flatnonzero(counts & (lie.id >= 0)).tolist():
                key = lie.agent, lie.attack, int(lie.id[row])
                self.ghosts.setdefault(key, Deception()).add(bool(believed[row]))
            objects = truth.counted.boxes
            denied = objects[near(objects, lie.denied.transform(base_SE3_world))]
            self.denied += len(denied)
            self.hidden += int((~near(denied, tracks.boxes)).sum())


def _inside(boxes: Boxes3D, region_m: Floats | None) -> Mask:
    if region_m is None:
        return np.ones(len(boxes), np.bool_)
    return in_region(boxes.center, region_m)


def near(boxes: Boxes3D, others: Boxes3D) -> Mask:
    """Return the mask (N,) of boxes with one of the others within `NEAR_M` on the ground."""
    if not len(others):
        return np.zeros(len(boxes), np.bool_)
    apart = boxes.center[:, None, :2] - others.center[None, :, :2]
    found: Mask = np.any(np.hypot(apart[..., 0], apart[..., 1]) <= NEAR_M, axis=1)
    return found


class DeceptionRecorder(Recorder):
    """Lies that honest agents are told, and what they believe of them, by agent; nothing where nobody may lie."""

    def begin(self, episode: Episode) -> None:
        liars = episode.facts.get("attackers", ())
        self._logs = {name: DeceptionLog() for name in episode.frame.agents if liars and name not in liars}

    def on_report(self, episode: Episode) -> None:
        region_m = episode.env.region_m
        region = None if region_m is None else np.array(region_m)
        for name, log in self._logs.items():
            agent = episode.frame.agents.get(name)
            if agent is not None:
                log.append(episode.lies, agent.body.world_SE3_base, agent.truth, episode.tracks[name], region)

    def records(self) -> dict[str, DeceptionLog]:
        return {name: log for name, log in self._logs.items() if log.ghosts or log.denied}
