"""Samples of feature flow: fused ones whose late senders have a map before and a map of now as well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.samples.fused_samples import LATEST_S, CooperativeSample, SceneDraft
from coopsim.localization.odometry import Points
from coopsim.nn.cooperative.cooperative_net import LONGEST_S
from coopsim.types import stack_xyz_yaw


@dataclass(frozen=True, slots=True, eq=False)
class LateMaps:
    """The maps of L late messages, those of their senders before, and those of now.

    Attributes:
        late, before, later: (L,) numbers of the maps in the sample.
        before_SE2_late, later_SE2_late: (L, 3) x m, y m, yaw rad of the late map's frame in those of the others, by
            their senders' odometry.
        interval_s: (L,) time between the map before and the late one.
        delay_s: (L,) time between the late one and now.
    """

    late: list[int]
    before: list[int]
    later: list[int]
    before_SE2_late: Floats
    later_SE2_late: Floats
    interval_s: list[float]
    delay_s: list[float]


@dataclass(frozen=True, slots=True, eq=False)
class FlowSample:
    """A sample, with late maps as they were sent, and the maps before and after them."""

    scene: CooperativeSample
    late: LateMaps


class FlowDraft(SceneDraft):
    """Draft of a `FlowSample`.

    Messages are late from the third scene on, because flow needs a map before; none is older than 0.5 s.
    """

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._left_out: dict[int, float] = {}

    def sample(self) -> FlowSample:
        views, late = self.views(), self._late_maps()
        return FlowSample(self.sample_of(views), late)

    def age(self) -> int:
        most = min(self.number - 1, int(LATEST_S / self.clip.dt_s + 1e-6))
        late = most > 0 and self.clip.dt_s <= LONGEST_S and self.rng.random() < self.settings.late
        return int(self.rng.integers(1, most + 1)) if late else 0

    def thinned(self, points: Points, member: int) -> Points:
        """Leave out the same share of a member's points in all its maps: otherwise they would change by that."""
        if member not in self._left_out:
            thinned = self.rng.random() < self.settings.thinned
            self._left_out[member] = self.rng.uniform(0.0, 0.75) if thinned else 0.0
        share = self._left_out[member]
        return points[self.rng.random(len(points)) >= share] if share else points

    def _late_maps(self) -> LateMaps:
        rows, ways = [], []
        senders = [member for member, age in self.ages.items() if age and (self.number - age, member) in self.rows]
        for sender in senders:
            then = self.number - self.ages[sender]
            rows.append([self.row(number, sender) for number in (then, then - 1, self.number)])
            before_SE3_late = self._way(then - 1, then, sender)
            later_SE3_late = self._way(then, self.number, sender).inverse()
            ways.append([self._planar(before_SE3_late), self._planar(later_SE3_late)])
        placed = np.array(ways).reshape(-1, 2, 3)
        late, before, later = (list(each) for each in zip(*rows, strict=True)) if rows else ([], [], [])
        delay_s = [self.ages[sender] * self.clip.dt_s for sender in senders]
        return LateMaps(
            late, before, later, placed[:, 0], placed[:, 1], [self.clip.dt_s] * len(senders), delay_s
        )  # fmt: skip

    def _way(self, first: int, last: int, member: int) -> SE3:
        """Return the frame of a member's map in a scene, in that of its map in an earlier scene, by its odometry."""
        scenes = [scene.agents[member] for scene in self.clip.scenes[first : last + 1]]
        frames = [self.frames[self.row(number, member)] for number in (first, last)]
        base_SE3_maps = [
            _pose(agent.xyz_yaw).inverse().compose(_pose(frame))
            for agent, frame in zip((scenes[0], scenes[-1]), frames, strict=True)
        ]
        way = base_SE3_maps[0].inverse()
        for agent in scenes[1:]:
            way = way.compose(_pose(agent.odometry))
        return way.compose(base_SE3_maps[1])

    def _planar(self, transform: SE3) -> Floats:
        x, y, _, yaw = stack_xyz_yaw(transform)
        return np.array([x, -y, -yaw] if self.mirrored else [x, y, yaw])


def _pose(xyz_yaw: Floats) -> SE3:
    return SE3.from_xyz_yaw(xyz_yaw[:3], float(xyz_yaw[3]))
