"""Samples for stage A: one cloud, of one agent or of several together, and the objects that it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.anchor_loss import Truth, anchor_head_loss
from coopsim.learn.losses import head_loss
from coopsim.learn.scene import AgentScene, Clip, Scene
from coopsim.learn.targets import Targets, join_targets, make_targets
from coopsim.localization.recent_sweeps import LONGEST_S, Points
from coopsim.nn.anchor_head import AnchorHead
from coopsim.nn.detector_net import DetectorNet
from coopsim.nn.encoder import STRIDE
from coopsim.nn.pillars import PillarBatch, Pillars, collate, pillarize
from coopsim.support.checks import require_between, require_count, require_positive, require_probability
from coopsim.types import BevGrid


@dataclass(frozen=True, slots=True)
class SampleSettings:
    """How samples are made of scenes.

    Attributes:
        reach_m: half the edge of the square in which an agent's map lies.
        crop_cells: edge of the part of it that a sample shows, in pillars; None: the whole square.
        merged: share of samples with the points of several agents, for early fusion.
        thinned: share of samples of which points are left out at random, up to three quarters.
        mirrored: share of samples seen in a mirror.
        noise_m: largest standard deviation of the agents' positions where clouds are merged or maps fused.
        noise_deg: the same of their headings.
        dropout: probability that an agent does not take part in a merged or fused sample.
        late: share of fused samples with messages from earlier scenes.
        sparse: share of fused samples of which only the surest cells arrive.
    """

    reach_m: float = 76.8
    crop_cells: int | None = 128
    merged: float = 0.25
    thinned: float = 0.3
    mirrored: float = 0.5
    noise_m: float = 0.0
    noise_deg: float = 0.0
    dropout: float = 0.2
    late: float = 0.5
    sparse: float = 0.0

    def __post_init__(self) -> None:
        require_positive(reach_m=self.reach_m)
        if self.crop_cells is not None:
            require_count(8, crop_cells=self.crop_cells)
        require_between(0, 10, noise_m=self.noise_m, noise_deg=self.noise_deg)
        require_probability(
            merged=self.merged, thinned=self.thinned, mirrored=self.mirrored, dropout=self.dropout, late=self.late,
            sparse=self.sparse,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class DetectorSample:
    """One cloud in pillars, the targets of its map, and the objects that they are made of."""

    pillars: Pillars
    targets: Targets
    truth: Truth


@dataclass(frozen=True, slots=True, eq=False)
class DetectorBatch:
    """Samples of one shape."""

    pillars: PillarBatch
    targets: Targets
    truth: tuple[Truth, ...]


def detector_samples(
    clip: Clip, rng: np.random.Generator, settings: SampleSettings, cell_m: float = 0.6, sweeps: int = 1
) -> list[DetectorSample]:
    """Return a sample for each agent in each scene of a clip.

    Args:
        clip: the scenes.
        rng: decides what is merged, the turn, mirror and part of each sample.
        settings: how.
        cell_m: edge of a pillar.
        sweeps: frames that the network is given, see `sweeps_of`.
    """
    return [
        _sample(
            scene,
            number,
            [sweeps_of(clip, k, other, sweeps) for other in range(len(scene.agents))],
            rng,
            settings,
            cell_m,
        )
        for k, scene in enumerate(clip.scenes)
        for number, agent in enumerate(scene.agents)
        if len(agent.points)
    ]


def collate_detector(samples: Sequence[DetectorSample]) -> DetectorBatch:
    """Join samples into a batch."""
    return DetectorBatch(
        collate([sample.pillars for sample in samples]),
        join_targets([sample.targets for sample in samples]),
        tuple(sample.truth for sample in samples),
    )


def detector_loss(net: DetectorNet, batch: DetectorBatch) -> dict[str, Tensor]:
    """Return the loss of a batch: "loss", the weighted sum, and its parts."""
    features = net.encoder(batch.pillars)
    if isinstance(net.head, AnchorHead):
        return anchor_head_loss(net.head, features, batch.truth)
    return head_loss(net.head, features, batch.targets)


def sweeps_of(clip: Clip, number: int, member: int, sweeps: int) -> Points:
    """Return an agent's points in a scene, (P, 5) with their age, in its base frame.

    Args:
        clip: the scenes.
        number: of the scene.
        member: number of the agent.
        sweeps: 1, or 2 with the points of the scene before, moved by odometry. There are none in a first scene, or if
            the scenes are further apart than frames that a policy joins.
    """
    agent = clip.scenes[number].agents[member]
    points = _with_age(agent.points, 0.0)
    if sweeps == 1 or number == 0 or clip.dt_s > LONGEST_S:
        return points
    before = _with_age(clip.scenes[number - 1].agents[member].points, clip.dt_s)
    return np.concatenate([points, moved(before, np.zeros(4), agent.odometry)])


def _with_age(points: NDArray[np.float32], age_s: float) -> Points:
    return np.column_stack([points, np.full(len(points), age_s, np.float32)])


def moved(points: Points, xyz_yaw: Floats, to_xyz_yaw: Floats) -> Points:
    """Return points (P, 5), given in one frame, in another.

    Args:
        points: x, y, z, intensity, age.
        xyz_yaw: (4,) pose of the frame that they are in.
        to_xyz_yaw: (4,) pose of the other frame, in the same world.
    """
    cos, sin = np.cos(xyz_yaw[3] - to_xyz_yaw[3]), np.sin(xyz_yaw[3] - to_xyz_yaw[3])
    dx, dy = rotated((xyz_yaw[:2] - to_xyz_yaw[:2])[None], -to_xyz_yaw[3])[0]
    out, x, y = points.copy(), points[:, 0], points[:, 1]
    out[:, 0] = cos * x - sin * y + dx
    out[:, 1] = sin * x + cos * y + dy
    out[:, 2] += xyz_yaw[2] - to_xyz_yaw[2]
    return out


def boxes_in(boxes: Floats, velocity: Floats, to_xyz_yaw: Floats) -> tuple[Floats, Floats]:
    """Return boxes (N, 7) and velocities (N, 2), given in the world, in the frame of a pose (4,)."""
    out = boxes.copy()
    out[:, :2] = rotated(boxes[:, :2] - to_xyz_yaw[:2], -to_xyz_yaw[3])
    out[:, 2] -= to_xyz_yaw[2]
    out[:, 6] -= to_xyz_yaw[3]
    return out, rotated(velocity, -to_xyz_yaw[3])


def noisy(xyz_yaw: Floats, rng: np.random.Generator, noise_m: float, noise_rad: float) -> Floats:
    """Return an estimate of a pose (4,): x and y with an error of `noise_m`, the heading of `noise_rad`."""
    return xyz_yaw + rng.normal(size=4) * [noise_m, noise_m, 0.0, noise_rad]


def thin(points: Points, rng: np.random.Generator, share: float) -> Points:
    """Leave out up to three quarters of the points at random, in this share of calls."""
    if rng.random() >= share:
        return points
    return points[rng.random(len(points)) >= rng.uniform(0.0, 0.75)]


def mirror(points: Points, boxes: Floats, velocity: Floats) -> None:
    """Turn left and right around, in place: y becomes -y."""
    points[:, 1] *= -1
    boxes[:, [1, 6]] *= -1
    velocity[:, 1] *= -1


def _sample(
    scene: Scene,
    number: int,
    clouds: Sequence[Points],
    rng: np.random.Generator,
    settings: SampleSettings,
    cell_m: float,
) -> DetectorSample:
    me = scene.agents[number]
    members = _members(scene, number, rng, settings)
    # The frame of the map is turned at random: streets must not be known by their direction.
    frame = me.xyz_yaw.copy()
    frame[3] = rng.uniform(-np.pi, np.pi)
    points = np.concatenate(
        [_cloud(scene.agents[each], clouds[each], each == number, frame, rng, settings) for each in members]
    )
    shown = scene.returns[:, members].sum(axis=1) > 0  # the agent itself too, where others see it
    boxes, velocity = boxes_in(scene.boxes[shown], scene.velocity[shown], frame)
    if rng.random() < settings.mirrored:
        mirror(points, boxes, velocity)
    grid = _part(boxes, rng, settings, cell_m)
    truth = Truth(boxes, scene.label[shown], grid.coarser(STRIDE))
    targets = make_targets(boxes, velocity, truth.label, truth.grid)
    return DetectorSample(pillarize(points, grid), targets, truth)


def _members(scene: Scene, number: int, rng: np.random.Generator, settings: SampleSettings) -> list[int]:
    """Return the numbers of the agents whose points a sample has, that of `number` first."""
    others = [each for each in range(len(scene.agents)) if each != number]
    if not others or rng.random() >= settings.merged:
        return [number]
    return [number, *(each for each in others if rng.random() >= settings.dropout)]


def _cloud(
    agent: AgentScene, points: Points, own: bool, frame: Floats, rng: np.random.Generator, settings: SampleSettings
) -> Points:
    points = thin(points, rng, settings.thinned)
    pose = agent.xyz_yaw
    if not own and settings.noise_m + settings.noise_deg > 0:
        strength = rng.random()
        pose = noisy(pose, rng, strength * settings.noise_m, np.deg2rad(strength * settings.noise_deg))
    return moved(points, pose, frame)


def _part(boxes: Floats, rng: np.random.Generator, settings: SampleSettings, cell_m: float) -> BevGrid:
    """Return the part of an agent's square that a sample shows: mostly around one of the objects."""
    cells = round(2 * settings.reach_m / cell_m)
    size = cells if settings.crop_cells is None else min(settings.crop_cells, cells)
    corner = rng.integers(0, cells - size + 1, size=2)
    reach = np.abs(boxes[:, :2]).max(axis=1, initial=0.0) < settings.reach_m
    if reach.any() and rng.random() < 0.7:
        middle = boxes[rng.choice(np.flatnonzero(reach)), :2] + rng.uniform(-0.4, 0.4, 2) * size * cell_m
        corner = np.clip(np.round((middle + settings.reach_m) / cell_m).astype(int) - size // 2, 0, cells - size)
    low = -settings.reach_m + corner * cell_m
    high = low + size * cell_m
    return BevGrid((low[0], high[0]), (low[1], high[1]), cell_m)


def rotated(xy: Floats, angle_rad: float) -> Floats:
    """Return points of the plane (N, 2), turned."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turned: Floats = xy @ np.array([[cos, sin], [-sin, cos]])
    return turned
