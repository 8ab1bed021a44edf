"""Samples of an encoder of images: some images of an agent, and the objects that they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import BLOCK, AgentScene, Clip, Picture, Scene, nearest_in_blocks
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.sample_frames import boxes_in, mirror, moved, rotated, sweeps_of, thin
from coopsim.learn.samples.targets import Targets, join_targets, make_targets
from coopsim.nn.camera.picture_batch import STRIDE_PX, PictureBatch, PictureView, SeenPicture, by_size, collate_pictures
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import PillarBatch, Pillars, collate, pillarize
from coopsim.sensors.camera.projection import project
from coopsim.types import BevGrid

_LEAST_PIXELS = 16
"""Least pixels of an object, in all images of its agent, for it to be found."""

_CAMERAS = (1, 2, 4)
"""Numbers of cameras in a sample, each as likely: four times as many images of one moment teach less than images of
four moments."""

_FARTHEST_M = 50.0
"""Objects around which parts of maps are cut are at most as far."""


@dataclass(frozen=True, slots=True, eq=False)
class PictureSample:
    """Images of an agent with their targets.

    Attributes:
        view: the images.
        depth_m: (h, w) float32 depth of the nearest surface in each cell of each image's features; 0: nothing.
        label: (h, w) uint8 class of that surface, for each image.
        pillars: the agent's points on the same canvas.
        targets: targets of its map.
    """

    view: PictureView
    depth_m: tuple[NDArray[np.float32], ...]
    label: tuple[NDArray[np.uint8], ...]
    pillars: Pillars
    targets: Targets


@dataclass(frozen=True, slots=True, eq=False)
class PicturesOfBatch:
    """Samples of one shape; depths and classes (M, h, w) are in the groups of the pictures."""

    pictures: PictureBatch
    depth_m: tuple[Tensor, ...]
    label: tuple[Tensor, ...]
    pillars: PillarBatch
    targets: Targets


def picture_samples(
    clip: Clip,
    rng: np.random.Generator,
    settings: SampleSettings,
    cell_m: float,
    *,
    points: bool = False,
    whole: bool = False,
) -> list[PictureSample]:
    """Return a sample for each agent with images in each scene of a clip.

    Args:
        clip: the scenes.
        rng: stream of cameras, turn, mirror, light and part of each sample.
        settings: options: `crop_cells`, `reach_m` and `mirrored`, with points also `merged` and `thinned`.
        cell_m: edge of a cell of the canvas.
        points: the network reads the agent's points, too: their objects are targets as well, and images get the depths
            that they measure. Some samples have other agents' points, too, like early fusion.
        whole: all images unchanged, and the whole map.
    """
    return [
        _sample(clip, number, member, rng, settings, cell_m, points, whole)
        for number, scene in enumerate(clip.scenes)
        for member, agent in enumerate(scene.agents)
        if agent.pictures
    ]


def collate_picture_samples(samples: Sequence[PictureSample]) -> PicturesOfBatch:
    """Join samples into a batch."""
    views = [sample.view for sample in samples]
    groups = by_size(views)
    return PicturesOfBatch(
        collate_pictures(views),
        tuple(torch.from_numpy(np.stack([samples[number].depth_m[k] for number, k in group])) for group in groups),
        tuple(torch.from_numpy(np.stack([samples[number].label[k] for number, k in group])) for group in groups),
        collate([sample.pillars for sample in samples]),
        join_targets([sample.targets for sample in samples]),
    )


def _sample(
    clip: Clip,
    number: int,
    member: int,
    rng: np.random.Generator,
    settings: SampleSettings,
    cell_m: float,
    points: bool,
    whole: bool,
) -> PictureSample:
    scene = clip.scenes[number]
    agent = scene.agents[member]
    chosen = agent.pictures if whole else _some(agent.pictures, rng)
    frame = agent.xyz_yaw.copy()
    frame[3] = rng.uniform(-np.pi, np.pi)
    frame[:2] += rng.uniform(-0.5, 0.5, 2) * cell_m * STRIDE
    members = [member, *(_others(scene, member, rng, settings) if points and not whole else ())]
    shown = _shown(scene, member, agent, chosen)
    if points:
        shown |= (scene.returns[:, members] > 0).any(1)
    boxes, velocity = boxes_in(scene.boxes[shown], scene.velocity[shown], frame)
    cloud = np.concatenate(
        [moved(sweeps_of(clip, number, each, 1), scene.agents[each].xyz_yaw, frame) for each in members]
    )
    if points and not whole:
        cloud = thin(cloud, rng, settings.thinned)
    points_m = moved(cloud, frame, agent.xyz_yaw)[:, :3] if points else None
    mirrored = rng.random() < settings.mirrored and not whole
    if mirrored:
        mirror(cloud, boxes, velocity)
    grid = _part(boxes, rng, replace(settings, crop_cells=None) if whole else settings, cell_m)
    way = rotated((agent.xyz_yaw[:2] - frame[:2])[None], -frame[3])[0]
    pose = np.append(way, agent.xyz_yaw[3] - frame[3])
    light = np.ones(3) if whole else rng.uniform(0.7, 1.4) * rng.uniform(0.9, 1.1, 3)
    surfaces = [_surfaces(picture, mirrored) for picture in chosen]
    return PictureSample(
        PictureView([_seen(picture, light) for picture in chosen], pose, grid, mirrored, points_m),
        tuple(depth_m for depth_m, _ in surfaces),
        tuple(label for _, label in surfaces),
        pillarize(cloud, grid),
        make_targets(boxes, velocity, scene.label[shown], grid.coarser(STRIDE)),
    )


def _others(scene: Scene, member: int, rng: np.random.Generator, settings: SampleSettings) -> list[int]:
    """Return the numbers of the other agents whose points a sample has."""
    if rng.random() >= settings.merged:
        return []
    return [each for each in range(len(scene.agents)) if each != member and rng.random() >= settings.dropout]


def _some(pictures: tuple[Picture, ...], rng: np.random.Generator) -> tuple[Picture, ...]:
    count = min(len(pictures), int(rng.choice(_CAMERAS)))
    return tuple(pictures[k] for k in sorted(rng.permutation(len(pictures))[:count]))


def _shown(scene: Scene, member: int, agent: AgentScene, chosen: Sequence[Picture]) -> NDArray[np.bool_]:
    """Return the mask (N,) of objects with enough pixels, and their middle in one of the chosen images."""
    assert scene.pixels is not None
    x, y = rotated(scene.boxes[:, :2] - agent.xyz_yaw[:2], -agent.xyz_yaw[3]).T
    middle = np.column_stack([x, y, scene.boxes[:, 2] - agent.xyz_yaw[2]])
    inside = np.zeros(len(middle), np.bool_)
    for picture in chosen:
        inside |= project(picture.calibration, middle).inside
    shown: NDArray[np.bool_] = (scene.pixels[:, member] >= _LEAST_PIXELS) & inside
    return shown


def _seen(picture: Picture, light: Floats) -> SeenPicture:
    rgb = picture.rgb
    if (light != 1).any():
        table = np.clip(np.arange(256)[:, None] * light, 0, 255).astype(np.uint8)
        rgb = np.stack([table[rgb[..., channel], channel] for channel in range(3)], axis=-1)
    return SeenPicture(rgb, picture.calibration)


def _surfaces(picture: Picture, mirrored: bool) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return depth and class of the nearest surface in each cell of the features."""
    depth_m, label = nearest_in_blocks(picture.depth_m.astype(np.float32), picture.label, STRIDE_PX // BLOCK)
    return (depth_m[:, ::-1].copy(), label[:, ::-1].copy()) if mirrored else (depth_m, label)


def _part(boxes: Floats, rng: np.random.Generator, settings: SampleSettings, cell_m: float) -> BevGrid:
    """Return the part of an agent's surroundings that a sample shows: around an object, or around the agent."""
    most = round(settings.reach_m / cell_m)
    if settings.crop_cells is None:
        return BevGrid(*2 * ((-most * cell_m, most * cell_m),), cell_m)
    size = min(settings.crop_cells, 2 * most)
    near = np.flatnonzero(np.hypot(boxes[:, 0], boxes[:, 1]) < _FARTHEST_M)
    middle = boxes[rng.choice(near), :2] if len(near) else np.zeros(2)
    corner = np.round((middle + rng.uniform(-0.35, 0.35, 2) * size * cell_m) / cell_m).astype(int) - size // 2
    low = np.clip(corner, -most, most - size) * cell_m
    high = low + size * cell_m
    return BevGrid((low[0], high[0]), (low[1], high[1]), cell_m)
