"""Samples for stage B: a scene of several agents whose messages are late and whose poses are estimates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.targets import Targets, make_targets
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.merged_cloud import merged_cloud
from coopsim.learn.samples.sample_frames import boxes_in, mirror, moved, noisy, rotated, sweeps_of, thin
from coopsim.localization.odometry import Points
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import PillarBatch, Pillars, collate, pillarize
from coopsim.nn.inference.perceiver import KINDS, way_to_world_cells
from coopsim.types import BevGrid

D = TypeVar("D", bound="SceneDraft")

LATEST_S = 0.5
"""The longest delay of a message in a sample."""

VIEW_CELLS, VIEW_REACH_M = 96, 100.8
"""Most cells of an edge of the part of a receiver's map that a sample shows, and how far from the receiver it lies at
most."""


@dataclass(frozen=True, slots=True, eq=False)
class ReceiverView:
    """One receiver, and the messages that it fuses.

    Attributes:
        own: number of its own map in the sample.
        others: numbers of the maps that it received.
        source_SE2_target: (S, 3) the place of its map in each sender's, as they believe: x m, y m, yaw rad.
        delay_s: (S,) age of each.
        kind: (S,) of the senders, by `KINDS`.
        own_kind: of the receiver.
        most_cells: number of the surest cells that each message has; None: all.
        grid: the part of its map that is taught.
        targets: there, of all objects that the receiver or a sender has seen. The receiver is among them where a sender
            has seen it: a network cannot know who it is, so a policy drops the boxes over its agent.
        merged: the points of all agents there, for a teacher; None: there is none.
    """

    own: int
    others: tuple[int, ...]
    source_SE2_target: Floats
    delay_s: Tensor
    kind: Tensor
    own_kind: int
    most_cells: int | None
    grid: BevGrid
    targets: Targets
    merged: PillarBatch | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CooperativeSample:
    """The clouds of one moment, and of earlier ones where messages are late, and the receivers among them.

    Attributes:
        pillars: A clouds, each in its agent's compass frame, moved to the nearest corner of the world's cells.
        seen: (A, 9, h, w) heat of the objects that each cloud shows.
        objects: their number.
        grid: the cells of all features.
        views: of the receivers.
    """

    pillars: PillarBatch
    seen: Tensor
    objects: int
    grid: BevGrid
    views: tuple[ReceiverView, ...]


def scene_samples(
    clip: Clip,
    rng: np.random.Generator,
    settings: SampleSettings,
    cell_m: float = 0.6,
    sweeps: int = 1,
    *,
    taught: bool = False,
) -> list[CooperativeSample]:
    """Return a sample for each scene of a clip that two or more agents take part in.

    Args:
        clip: the scenes.
        rng: decides who takes part, the errors of poses, delays, and the turn and mirror of the world.
        settings: how.
        cell_m: edge of a pillar.
        sweeps: frames that the network is given, see `sweeps_of`.
        taught: there is a teacher, who is shown the points of all.
    """
    drafts = scene_drafts(SceneDraft, clip, rng, settings, cell_m, sweeps, taught)
    return [draft.sample() for draft in drafts]


def scene_drafts(
    kind: type[D],
    clip: Clip,
    rng: np.random.Generator,
    settings: SampleSettings,
    cell_m: float,
    sweeps: int,
    taught: bool,
) -> Iterator[D]:
    """Yield a draft of that kind for each scene that two or more agents take part in; arguments as of `scene_samples`.

    Who takes part is drawn of those that see anything. All draw from one stream: finish a draft before the next.
    """
    for number, scene in enumerate(clip.scenes):
        drawn = [k for k in range(len(scene.agents)) if rng.random() >= settings.dropout]
        members = [k for k in drawn if len(scene.agents[k].points)]
        if len(members) > 1:
            yield kind(clip, number, members, rng, settings, cell_m, sweeps, taught)


class SceneDraft:
    """One sample in the making; arguments as of `scene_samples`.

    Attributes:
        grid: the cells of all features.
        ages: by member, how many scenes its messages are late.
        rows: numbers of the maps, by scene and member.
        frames: (4,) true poses of the frames of the maps.
    """

    def __init__(
        self,
        clip: Clip,
        number: int,
        members: list[int],
        rng: np.random.Generator,
        settings: SampleSettings,
        cell_m: float,
        sweeps: int,
        taught: bool = False,
    ) -> None:
        self.clip, self.number, self.members, self.rng, self.settings = clip, number, members, rng, settings
        self.sweeps, self.taught = sweeps, taught
        self.pillar_grid = BevGrid(*2 * ((-settings.reach_m, settings.reach_m),), cell_m)
        self.grid = self.pillar_grid.coarser(STRIDE)
        self.strength = rng.random() * float(rng.random() < settings.noisy)
        self.axes_rad = rng.uniform(-np.pi, np.pi)
        self.mirrored = rng.random() < settings.mirrored
        self.ages = {member: self.age() for member in members}
        self.rows: dict[tuple[int, int], int] = {}
        self.clouds: list[Pillars] = []
        self.seen: list[Targets] = []
        self.frames: list[Floats] = []
        self.middles: list[Floats] = []

    def sample(self) -> CooperativeSample:
        """Return the sample."""
        return self.sample_of(self.views())

    def views(self) -> tuple[ReceiverView, ...]:
        """Return the receivers' views; the maps that they need are made."""
        return tuple(self._view(member) for member in self._receivers())

    def sample_of(self, views: tuple[ReceiverView, ...]) -> CooperativeSample:
        """Return the sample of all maps that were made."""
        return CooperativeSample(
            collate(self.clouds),
            torch.cat([targets.heat for targets in self.seen]),
            sum(targets.objects for targets in self.seen),
            self.grid,
            views,
        )

    def _receivers(self) -> list[int]:
        most = self.settings.receivers
        if most is None or most >= len(self.members):
            return self.members
        return sorted(self.rng.choice(self.members, most, replace=False).tolist())

    def row(self, number: int, member: int) -> int:
        """Return the number of an agent's map in a scene; it is made when first asked for."""
        if (number, member) not in self.rows:
            self.rows[number, member] = len(self.rows)
            self._add(number, member)
        return self.rows[number, member]

    def _add(self, number: int, member: int) -> None:
        scene, settings = self.clip.scenes[number], self.settings
        agent = scene.agents[member]
        noise_rad = np.deg2rad(self.strength * settings.noise_deg)
        believed = noisy(agent.xyz_yaw, self.rng, self.strength * settings.noise_m, noise_rad)
        # The agent turns its points by the heading that it believes in: its map's axes are off by its error. The map
        # lies on the cells of the world, of which those nearest to where the agent believes to be are in its middle.
        place = rotated(believed[None, :2], -self.axes_rad)[0]
        way = way_to_world_cells(place, self.grid.cell_m)
        frame = agent.xyz_yaw.copy()
        frame[3] = self.axes_rad - (believed[3] - agent.xyz_yaw[3])
        frame[:2] += rotated(way[None], frame[3])[0]
        points = self.thinned(sweeps_of(self.clip, number, member, self.sweeps), member)
        points = moved(points, agent.xyz_yaw, frame)
        shown = scene.returns[:, member] > 0
        boxes, velocity = boxes_in(scene.boxes[shown], scene.velocity[shown], frame)
        if self.mirrored:
            mirror(points, boxes, velocity)
        self.clouds.append(pillarize(points, self.pillar_grid))
        self.seen.append(make_targets(boxes, velocity, scene.label[shown], self.grid))
        self.frames.append(frame)
        self.middles.append(place + way)

    def thinned(self, points: Points, member: int) -> Points:
        """Return what is left of a member's points in one map."""
        return thin(points, self.rng, self.settings.thinned)

    def _view(self, member: int) -> ReceiverView:
        scene, own = self.clip.scenes[self.number], self.row(self.number, member)
        known = scene.returns[:, member] > 0
        others, delays, kinds, offsets = [], [], [], []
        for sender in self.members:
            if sender == member:
                continue
            then = self.number - self.ages[sender]
            others.append(self.row(then, sender))
            delays.append((self.number - then) * self.clip.dt_s)
            kinds.append(KINDS.index(scene.agents[sender].kind))
            offsets.append(self._offset(own, others[-1]))
            before = self.clip.scenes[then]
            known |= np.isin(scene.object_id, before.object_id[before.returns[:, sender] > 0])
        boxes, velocity = boxes_in(scene.boxes[known], scene.velocity[known], self.frames[own])
        if self.mirrored:
            mirror(np.zeros((0, 5), np.float32), boxes, velocity)
        grid = self._part(boxes)
        most = int(2 ** self.rng.uniform(4.0, 10.0)) if self.rng.random() < self.settings.sparse else None
        return ReceiverView(
            own, tuple(others), np.array(offsets), torch.tensor(delays), torch.tensor(kinds),
            KINDS.index(scene.agents[member].kind), most, grid,
            make_targets(boxes, velocity, scene.label[known], grid), self._merged(own, grid),
        )  # fmt: skip

    def _merged(self, own: int, grid: BevGrid) -> PillarBatch | None:
        """Return what a teacher sees in a part of a receiver's map; None: there is no teacher."""
        if not self.taught:
            return None
        frame, sweeps = self.frames[own], self.sweeps
        return merged_cloud(self.clip, self.number, self.members, frame, grid, sweeps=sweeps, mirrored=self.mirrored)

    def age(self) -> int:
        """Return how many scenes a sender's messages are late: all receivers get the same ones."""
        most = min(self.number, int(LATEST_S / self.clip.dt_s + 1e-6))
        return int(self.rng.integers(1, most + 1)) if most and self.rng.random() < self.settings.late else 0

    def _offset(self, own: int, other: int) -> Floats:
        x, y = self.middles[own] - self.middles[other]
        return np.array([x, -y if self.mirrored else y, 0.0])

    def _part(self, boxes: Floats) -> BevGrid:
        """Return a part of the receiver's surroundings, of whole cells of its own map, mostly around an object."""
        cell_m = self.grid.cell_m
        low = round(VIEW_REACH_M / cell_m)
        size = min(VIEW_CELLS, 2 * low)
        corner = self.rng.integers(-low, low - size + 1, size=2)
        near = np.flatnonzero(np.abs(boxes[:, :2]).max(axis=1, initial=0.0) < VIEW_REACH_M)
        if len(near) and self.rng.random() < 0.8:
            middle = boxes[self.rng.choice(near), :2] / cell_m + self.rng.uniform(-0.4, 0.4, 2) * size
            corner = np.clip(np.round(middle).astype(int) - size // 2, -low, low - size)
        start, end = corner * cell_m, (corner + size) * cell_m
        return BevGrid((start[0], end[0]), (start[1], end[1]), cell_m)
