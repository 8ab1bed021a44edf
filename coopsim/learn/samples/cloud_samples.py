"""Samples for stage A: one cloud, of one agent or of several together, and the objects that it shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.learn.samples.moved_boxes import MovedBoxes, join_moved, moved_boxes
from coopsim.learn.samples.sample_frames import boxes_in, joined, mirror, moved, noisy, sweeps_of, thin, tilt
from coopsim.learn.samples.targets import Targets, join_targets, make_targets
from coopsim.localization.odometry import Points
from coopsim.nn.detector.encoder import STRIDE, EncoderConfig
from coopsim.nn.detector.pillars import GroundSettings, PillarBatch, Pillars, collate, pillarize
from coopsim.nn.inference.canvas import REACH_M
from coopsim.recordings.recorded_scene import count_points_in
from coopsim.support.checks import require_between, require_count, require_positive, require_probability
from coopsim.types import BevGrid, Ints


@dataclass(frozen=True, slots=True)
class SampleSettings:
    """Options of samples.

    Attributes:
        reach_m: half the edge of the square in which an agent's map lies.
        crop_cells: edge of the part of it that a sample shows, in pillars; None: the whole square.
        merged: share of samples with the points of several agents, for early fusion.
        thinned: share of samples without some of their points, up to three quarters.
        single: share of samples with one sweep among those of which two are there.
        mirrored: share of mirrored samples.
        noise_m: largest standard deviation of the agents' positions where clouds are merged or maps fused.
        noise_deg: largest standard deviation of their headings.
        noisy: share of fused samples, and of clouds that are merged, with such errors.
        dropout: probability that an agent does not take part in a merged or fused sample.
        late: share of fused samples with messages from earlier scenes.
        sparse: share of fused samples of which only the surest cells arrive.
        clean: share of fused samples without errors of poses, late messages and missing cells; `noisy`, `late` and
            `sparse` are shares of the others.
        receivers: most agents of a fused sample whose view is taught, drawn anew for each; None: every agent. The
            others send: a costly fusion is trained on as many scenes in less time.
        tilt_deg: standard deviation of pitch and roll of the agent, as when it brakes, turns or climbs, drawn anew for
            each sample of stage A: points and boxes tilt together.
        quickest: largest factor on the speed of clips of queries and integrated tracking, drawn anew for each use, with
            at least 0.1 s between two scenes: the traffic of towns is then as fast as that of motorways.
    """

    reach_m: float = REACH_M
    crop_cells: int | None = 128
    merged: float = 0.25
    thinned: float = 0.3
    single: float = 0.2
    mirrored: float = 0.5
    noise_m: float = 0.0
    noise_deg: float = 0.0
    noisy: float = 1.0
    dropout: float = 0.2
    late: float = 0.5
    sparse: float = 0.0
    clean: float = 0.0
    receivers: int | None = None
    quickest: float = 1.0
    tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        require_positive(reach_m=self.reach_m)
        if self.crop_cells is not None:
            require_count(8, crop_cells=self.crop_cells)
        if self.receivers is not None:
            require_count(1, receivers=self.receivers)
        require_between(0, 10, noise_m=self.noise_m, noise_deg=self.noise_deg, tilt_deg=self.tilt_deg)
        require_between(1, 10, quickest=self.quickest)
        require_probability(
            merged=self.merged, thinned=self.thinned, single=self.single, mirrored=self.mirrored, noisy=self.noisy,
            dropout=self.dropout, late=self.late, sparse=self.sparse, clean=self.clean,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class DetectorSample:
    """A cloud in pillars, the targets of its map, and boxes whose motions it shows; None: the encoder tells none."""

    pillars: Pillars
    targets: Targets
    moved: MovedBoxes | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DetectorBatch:
    """Samples of one shape."""

    pillars: PillarBatch
    targets: Targets
    moved: MovedBoxes | None = None


USUAL = EncoderConfig()
"""Options of an encoder, of which samples need the pillars and the sweeps (see `sweeps_of`)."""


def detector_samples(
    clip: Clip, rng: np.random.Generator, settings: SampleSettings, encoder: EncoderConfig = USUAL
) -> list[DetectorSample]:
    """Return a sample for each agent in each scene of a clip, for an encoder."""
    samples = []
    for k, scene in enumerate(clip.scenes):
        for number, agent in enumerate(scene.agents):
            if not len(agent.points):
                continue
            double = encoder.sweeps == 2 and joined(clip, k) and rng.random() >= settings.single
            cloud_of = partial(sweeps_of, clip, k, sweeps=1 + double)
            moves = double or encoder.sweeps == 1
            samples.append(_sample(scene, number, cloud_of, rng, settings, encoder, moves))
    return samples


def collate_detector(samples: Sequence[DetectorSample]) -> DetectorBatch:
    """Join samples into a batch."""
    moved = [sample.moved for sample in samples if sample.moved is not None]
    return DetectorBatch(
        collate([sample.pillars for sample in samples]),
        join_targets([sample.targets for sample in samples]),
        join_moved(moved) if moved else None,
    )


def _sample(
    scene: Scene, number: int, cloud_of: Callable[[int], Points], rng: np.random.Generator, settings: SampleSettings,
    encoder: EncoderConfig, moves: bool,
) -> DetectorSample:  # fmt: skip
    me = scene.agents[number]
    members = _members(scene, number, rng, settings)
    # The frame of the map is turned at random: streets must not be known by their direction. The agent is anywhere in
    # the cell in the middle, as maps that are exchanged lie on cells of the world (`coopsim.nn.cooperative.perceiver`).
    frame = me.xyz_yaw.copy()
    frame[3] = rng.uniform(-np.pi, np.pi)
    frame[:2] += rng.uniform(-0.5, 0.5, 2) * encoder.cell_m * STRIDE
    points = np.concatenate(
        [_cloud(scene.agents[each], cloud_of(each), each == number, frame, rng, settings) for each in members]
    )
    shown = np.flatnonzero(scene.returns[:, members].sum(axis=1))  # the agent itself too, where others see it
    doubts = np.zeros((0, 7)) if scene.doubtful is None else scene.doubtful
    boxes = np.concatenate([scene.boxes[shown], doubts])
    velocity = np.concatenate([scene.velocity[shown], np.zeros((len(doubts), 2))])
    boxes, velocity = boxes_in(boxes, velocity, frame)
    if rng.random() < settings.mirrored:
        mirror(points, boxes, velocity)
    if settings.tilt_deg > 0:
        tilt(points, boxes, np.deg2rad(settings.tilt_deg) * rng.standard_normal(2))
    grid = _part(boxes[: len(shown)], rng, settings, encoder.cell_m)
    left = points_left(points, boxes, grid)
    unlabelled = np.arange(len(boxes)) >= len(shown)
    kept, doubtful = (left > 0) | unlabelled, (left < LEAST_POINTS) | unlabelled
    label = np.append(scene.label[shown], np.zeros(len(doubts), np.int64))
    targets = make_targets(boxes[kept], velocity[kept], label[kept], grid.coarser(STRIDE), doubtful[kept], moves=moves)
    pillars = pillarize(points, grid, encoder.pillars)
    if not encoder.tells_motion:
        return DetectorSample(pillars, targets)
    told = kept & ~doubtful & moves
    return DetectorSample(pillars, targets, moved_boxes(points, boxes[told], velocity[told], rng))


LEAST_POINTS = 3
"""Points of the last sweep that an object of a sample must have to be taught; with fewer it counts neither way."""


def points_left(points: Points, boxes: Floats, grid: BevGrid) -> Ints:
    """Return the number of points (N,) of the last sweep in each box, in the part of the map that a sample shows."""
    inside = (points[:, 0] >= grid.x_m[0]) & (points[:, 0] < grid.x_m[1]) & (points[:, 4] == 0)
    inside &= (points[:, 1] >= grid.y_m[0]) & (points[:, 1] < grid.y_m[1])
    raised = boxes.copy()
    above_m = GroundSettings().above_m  # points below are taken for the ground
    raised[:, 5] = np.maximum(raised[:, 5] - above_m, 0.1)
    raised[:, 2] += above_m / 2
    return count_points_in(Boxes3D.from_array(raised), [points[inside, :3]])


def _members(scene: Scene, number: int, rng: np.random.Generator, settings: SampleSettings) -> list[int]:
    """Return the numbers of the agents whose points a sample has, `number` first."""
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
        strength = rng.random() * float(rng.random() < settings.noisy)
        pose = noisy(pose, rng, strength * settings.noise_m, np.deg2rad(strength * settings.noise_deg))
    return moved(points, pose, frame)


def _part(boxes: Floats, rng: np.random.Generator, settings: SampleSettings, cell_m: float) -> BevGrid:
    """Return the part of an agent's square that a sample shows, mostly around an object."""
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
