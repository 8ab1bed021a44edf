"""Samples for stage B: a scene of several agents whose messages are late and whose poses are estimates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.samples.cloud_samples import LEAST_POINTS, USUAL, SampleSettings, points_left
from coopsim.learn.samples.sample_frames import boxes_in, mirror, moved, noisy, rotated, sweeps_of, thin
from coopsim.learn.samples.targets import Targets, make_targets
from coopsim.localization.odometry import Points
from coopsim.nn.cooperative.perceiver import KINDS
from coopsim.nn.detector.encoder import STRIDE, EncoderConfig
from coopsim.nn.detector.pillars import PillarBatch, Pillars, collate, pillarize
from coopsim.nn.inference.canvas import way_to_world_cells
from coopsim.types import BevGrid, Ints

LATEST_S = 0.5
"""The longest delay of a message in a sample."""

VIEW_CELLS, VIEW_REACH_M = 96, 100.8
"""Most cells of an edge of the part of a receiver's map that a sample shows, and how far from the receiver it lies at
most."""


@dataclass(frozen=True, slots=True, eq=False)
class ReceiverView:
    """A receiver, and the messages that it fuses.

    Attributes:
        own: number of its own map in the sample.
        others: numbers of the maps that it received.
        source_SE2_target: (S, 3) pose of its map in each sender's, by their estimates: x m, y m, yaw rad.
        delay_s: (S,) ages of the messages.
        kind: (S,) kinds of the senders, by `KINDS`.
        own_kind: kind of the receiver.
        most_cells: number of the surest cells that each message has; None: all.
        grid: the part of its map that is taught.
        targets: targets there of all objects that the receiver or a sender has seen. The receiver is among them where a
            sender has seen it: a network cannot know its agent, so a policy drops the boxes over it.
        merged: the points of all agents there, for a teacher, if any.
        error: standard deviations of a sender's place (m) and heading (rad) in the receiver's frame, as agents state.
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
    error: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class CooperativeSample:
    """The clouds of a moment, and of earlier ones where messages are late, and the receivers among them.

    Attributes:
        pillars: A clouds, each in its agent's compass frame, moved to the nearest corner of the world's cells.
        seen: (A, 9, h, w) heat of the objects that each cloud shows.
        doubtful: (A, h, w) True near objects that hardly show, see `Targets.ignored`.
        objects: number of the objects.
        grid: cells of all features.
        views: views of the receivers.
    """

    pillars: PillarBatch
    seen: Tensor
    doubtful: Tensor
    objects: int
    grid: BevGrid
    views: tuple[ReceiverView, ...]


def scene_samples(
    clip: Clip, rng: np.random.Generator, settings: SampleSettings, encoder: EncoderConfig = USUAL,
    *, taught: bool = False, draft: Callable[..., SceneDraft] | None = None,
) -> list[Any]:  # fmt: skip
    """Return a sample for each scene of a clip with two or more agents.

    Participants are drawn from the agents that see anything.

    Args:
        clip: the scenes.
        rng: stream of participants, errors of poses, delays, and the turn and mirror of the world.
        settings: options.
        encoder: options of the encoder.
        taught: add the merged points of all agents, for a teacher.
        draft: kind of draft that makes the samples; None: `SceneDraft`.
    """
    samples = []
    for number, scene in enumerate(clip.scenes):
        drawn = [k for k in range(len(scene.agents)) if rng.random() >= settings.dropout]
        members = [k for k in drawn if len(scene.agents[k].points)]
        if len(members) > 1:
            begun = (draft or SceneDraft)(clip, number, members, rng, settings, encoder, taught)
            samples.append(begun.sample())  # all drafts share a stream: each is finished before the next
    return samples


class SceneDraft:
    """Draft of a sample; arguments: see `scene_samples`.

    Attributes:
        grid: cells of all features.
        ages: delay of messages in scenes, by member.
        rows: numbers of the maps, by scene and member.
        frames: (4,) true poses of the frames of the maps.
    """

    def __init__(
        self, clip: Clip, number: int, members: list[int], rng: np.random.Generator, settings: SampleSettings,
        encoder: EncoderConfig = USUAL, taught: bool = False,
    ) -> None:  # fmt: skip
        self.clip, self.number, self.members, self.rng, self.settings = clip, number, members, rng, settings
        self.encoder, self.taught = encoder, taught
        self.pillar_grid = BevGrid(*2 * ((-settings.reach_m, settings.reach_m),), encoder.cell_m)
        self.grid = self.pillar_grid.coarser(STRIDE)
        self.clean = settings.clean > 0 and rng.random() < settings.clean
        if self.clean:
            self.settings = settings = replace(settings, noisy=0.0, late=0.0, sparse=0.0)
        self.strength = rng.random() * float(rng.random() < settings.noisy)
        self.axes_rad = rng.uniform(-np.pi, np.pi)
        self.mirrored = rng.random() < settings.mirrored
        self.ages = {member: self.age() for member in members}
        self.rows: dict[tuple[int, int], int] = {}
        self.left: list[dict[int, int]] = []
        self.clouds: list[Pillars] = []
        self.seen: list[Targets] = []
        self.frames: list[Floats] = []
        self.middles: list[Floats] = []

    def sample(self) -> Any:
        """Return the sample: a `CooperativeSample`, unless overridden."""
        return self.sample_of(self.views())

    def views(self) -> tuple[ReceiverView, ...]:
        """Return the receivers' views; the maps that they need are made."""
        return tuple(self._view(member) for member in self._receivers())

    def sample_of(self, views: tuple[ReceiverView, ...]) -> CooperativeSample:
        """Return the sample of all maps that were made."""
        return CooperativeSample(
            collate(self.clouds),
            torch.cat([targets.heat for targets in self.seen]),
            torch.cat([targets.ignored for targets in self.seen]),
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
        """Return the number of an agent's map in a scene, which is made when first asked for."""
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
        points = self.thinned(sweeps_of(self.clip, number, member, self.encoder.sweeps), member)
        points = moved(points, agent.xyz_yaw, frame)
        shown = scene.returns[:, member] > 0
        boxes, velocity = boxes_in(scene.boxes[shown], scene.velocity[shown], frame)
        if self.mirrored:
            mirror(points, boxes, velocity)
        self.clouds.append(pillarize(points, self.pillar_grid, self.encoder.pillars))
        left = points_left(points, boxes, self.pillar_grid)
        self.left.append(dict(zip(scene.object_id[shown].tolist(), left.tolist(), strict=True)))
        self.seen.append(_taught(boxes, velocity, scene.label[shown], left, self.grid))
        self.frames.append(frame)
        self.middles.append(place + way)

    def thinned(self, points: Points, member: int) -> Points:
        """Return the points of a member in a map, thinned."""
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
        left = np.array([sum(self.left[row].get(each, 0) for row in (own, *others)) for each in scene.object_id[known]])
        boxes, velocity = boxes_in(scene.boxes[known], scene.velocity[known], self.frames[own])
        if self.mirrored:
            mirror(np.zeros((0, 5), np.float32), boxes, velocity)
        grid = self._part(boxes)
        most = int(2 ** self.rng.uniform(4.0, 10.0)) if self.rng.random() < self.settings.sparse else None
        return ReceiverView(
            own, tuple(others), np.array(offsets), torch.tensor(delays), torch.tensor(kinds),
            KINDS.index(scene.agents[member].kind), most, grid,
            _taught(boxes, velocity, scene.label[known], left, grid), self._merged(own, grid),
            (2**0.5 * self.strength * self.settings.noise_m,
             2**0.5 * self.strength * float(np.deg2rad(self.settings.noise_deg))),
        )  # fmt: skip

    def _merged(self, own: int, grid: BevGrid) -> PillarBatch | None:
        """Return what a teacher sees in a part of a receiver's map, the points of all members, moved without error."""
        if not self.taught:
            return None
        agents, frame = self.clip.scenes[self.number].agents, self.frames[own]
        clouds = [(sweeps_of(self.clip, self.number, each, self.encoder.sweeps), each) for each in self.members]
        points = np.concatenate([moved(cloud, agents[each].xyz_yaw, frame) for cloud, each in clouds])
        if self.mirrored:
            mirror(points, np.zeros((0, 7)), np.zeros((0, 2)))
        cells = BevGrid(grid.x_m, grid.y_m, grid.cell_m / STRIDE)
        return collate([pillarize(points, cells, self.encoder.pillars)])

    def age(self) -> int:
        """Draw the delay of a sender's messages in scenes: all receivers get the same ones."""
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


def _taught(boxes: Floats, velocity: Floats, label: Ints, left: Ints, grid: BevGrid) -> Targets:
    """Return the targets of objects by the points (N,) that are left of them: see `LEAST_POINTS`; of none, nothing."""
    some = left > 0
    return make_targets(boxes[some], velocity[some], label[some], grid, (left < LEAST_POINTS)[some])
