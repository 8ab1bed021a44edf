"""Sightings of objects by agents, from which identity is learned: drawn in groups, compared, and cut out of images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.learn.clips.clip import AgentScene, Clip
from coopsim.learn.samples.sample_frames import boxes_in
from coopsim.nn.identity.picture_identity_net import cut_crops
from coopsim.sensors.camera.projection import best_crops
from coopsim.support.checks import require_count, require_non_negative, require_probability
from coopsim.types import Ints, Mask


@dataclass(frozen=True, slots=True)
class SightingSettings:
    """Options of the draw of sightings from clips, and errors of their boxes.

    Attributes:
        frames: frames before and after a sighting in which the same agent's sightings of the object are its
            positives, as in YOLOO.
        group: most identities of a group: these are of one class in one clip, so that most negatives of an object are
            of its class.
        least_returns: LiDAR returns from which an object is seen.
        least_pixels: pixels, in all of an agent's pictures, from which an object is seen.
        center_m: standard deviation of the error of a box's centre along each axis; half of it in height.
        size_share: standard deviation of the error of length, width and height, as a share of them.
        yaw_deg: standard deviation of the error of the heading.
        turned: share of boxes that face backwards.
        thinned: share of sightings without some of their points, up to three quarters.
    """

    frames: int = 3
    group: int = 8
    least_returns: int = 5
    least_pixels: int = 0
    center_m: float = 0.15
    size_share: float = 0.06
    yaw_deg: float = 5.0
    turned: float = 0.03
    thinned: float = 0.3

    def __post_init__(self) -> None:
        require_count(1, frames=self.frames, group=self.group)
        require_count(0, least_returns=self.least_returns, least_pixels=self.least_pixels)
        require_non_negative(center_m=self.center_m, size_share=self.size_share, yaw_deg=self.yaw_deg)
        require_probability(turned=self.turned, thinned=self.thinned)


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """M sightings: each an object that an agent sees in a scene of a clip.

    Attributes:
        scene: (M,) number of the scene in its clip.
        agent: (M,) number of the agent in its scene.
        identity: (M,) the object's id, equal for sightings of the same object.
        label: (M,) its `ObjectClass`.
        boxes: (M, 7) x, y, z, l, w, h, yaw in the agent's base frame.
        returns: (M,) LiDAR returns that the agent has of it.
    """

    scene: Ints
    agent: Ints
    identity: Ints
    label: Ints
    boxes: Floats
    returns: Ints

    def __len__(self) -> int:
        return len(self.scene)

    def take(self, rows: Ints | Mask) -> Sightings:
        """Return some of the sightings, by indices or a mask."""
        return Sightings(*(getattr(self, each.name)[rows] for each in fields(self)))

    def within_agents(self, frames: int) -> Mask:
        """Return which pairs (M, M) are of one agent in different scenes, at most `frames` apart."""
        apart = np.abs(self.scene[:, None] - self.scene)
        near: Mask = (self.agent[:, None] == self.agent) & (apart > 0) & (apart <= frames)
        return near

    def across_agents(self) -> Mask:
        """Return which pairs (M, M) are of two agents in the same scene."""
        pairs: Mask = (self.agent[:, None] != self.agent) & (self.scene[:, None] == self.scene)
        return pairs


def join_sightings(parts: Sequence[Sightings]) -> Sightings:
    """Return the sightings of several, one after the other."""
    return Sightings(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Sightings)))


def sightings_of(clip: Clip, settings: SightingSettings) -> Sightings:
    """Return all sightings of a clip, scene by scene and agent by agent, with true boxes.

    No agent sees itself. In clips without cameras `least_pixels` must be 0.
    """
    none = np.zeros(0, np.int64)
    found = [Sightings(none, none, none, none, np.zeros((0, 7)), none)]
    for number, scene in enumerate(clip.scenes):
        for member, agent in enumerate(scene.agents):
            returns = scene.returns[:, member]
            seen = (returns >= settings.least_returns) & (scene.object_id != agent.actor_id)
            if settings.least_pixels:
                seen &= np.zeros(len(seen), bool) if scene.pixels is None else (
                    scene.pixels[:, member] >= settings.least_pixels
                )  # fmt: skip
            boxes, _ = boxes_in(scene.boxes[seen], scene.velocity[seen], agent.xyz_yaw)
            where = np.full(len(boxes), number), np.full(len(boxes), member)
            found.append(Sightings(*where, scene.object_id[seen], scene.label[seen], boxes, returns[seen]))
    return join_sightings(found)


def jittered(seen: Sightings, rng: np.random.Generator, settings: SightingSettings) -> Sightings:
    """Return sightings with boxes as wrong as a detector's."""
    boxes, count = seen.boxes.copy(), len(seen)
    boxes[:, :3] += rng.normal(size=(count, 3)) * settings.center_m * [1.0, 1.0, 0.5]
    boxes[:, 3:6] *= np.exp(rng.normal(size=(count, 3)) * settings.size_share)
    turns = rng.normal(size=count) * np.deg2rad(settings.yaw_deg) + np.pi * (rng.random(count) < settings.turned)
    boxes[:, 6] = wrap_angle(boxes[:, 6] + turns)
    return replace(seen, boxes=boxes)


def draw_groups(seen: Sightings, rng: np.random.Generator, settings: SightingSettings) -> list[Ints]:
    """Draw groups of sightings of a clip: rows of identities of one class, two or three rows of each identity.

    Of each identity one row is an anchor, drawn, if possible, where it has positives of both kinds. With it come one of
    the same agent's within `settings.frames`, and one of another agent's in the same scene, as far as there are any.
    Identities without either are left out. No identity is in two groups.
    """
    within, across = seen.within_agents(settings.frames), seen.across_agents()
    groups = []
    for label in np.unique(seen.label):
        drawn = []
        for identity in rng.permutation(np.unique(seen.identity[seen.label == label])):
            rows = np.flatnonzero(seen.identity == identity)
            kinds = [kind[np.ix_(rows, rows)] for kind in (within, across)]
            known = sum(kind.any(1).astype(int) for kind in kinds)
            if not np.any(known):
                continue
            anchor = rng.choice(np.flatnonzero(known == np.max(known)))
            others = [rng.choice(np.flatnonzero(kind[anchor])) for kind in kinds if kind[anchor].any()]
            drawn.append(rows[[anchor, *others]])
        groups += [np.concatenate(drawn[k : k + settings.group]) for k in range(0, len(drawn), settings.group)]
    return groups


@dataclass(frozen=True, slots=True, eq=False)
class ComparedSightings:
    """K pairs of sightings of objects of the same class.

    Attributes:
        similarity: (K,) cosine of their vectors.
        same: (K,) whether they are of the same object.
        label: (K,) the class.
        returns: (K,) LiDAR returns of the one that has fewer.
    """

    similarity: Floats
    same: Mask
    label: Ints
    returns: Ints


def compare_sightings(vectors: NDArray[np.floating], seen: Sightings, pairs: Mask) -> ComparedSightings:
    """Compare the unit vectors (M, D) of a clip's sightings, for `pairs` (M, M, symmetric) of one class."""
    one, other = np.nonzero(np.triu(pairs & (seen.label[:, None] == seen.label), k=1))
    return ComparedSightings(
        np.einsum("kd,kd->k", vectors[one], vectors[other]).astype(np.float64),
        seen.identity[one] == seen.identity[other],
        seen.label[one],
        np.minimum(seen.returns[one], seen.returns[other]),
    )


LEAST_SHOWN = 0.15
"""Share of a crop's pixels that must be the object's; the rest is what stands before and behind it."""

_OTHER_CAMERA = 0.3
_MIRRORED = 0.25
_COVERED = 0.25

ResizedCrop = NDArray[np.uint8]
"""(3, E, E)."""


def sighted_crops(
    clip: Clip, seen: Sightings, edge_px: int, margin: float, rng: np.random.Generator | None = None
) -> list[ResizedCrop | None]:
    """Cut the boxes of sightings, with a margin (share of width and height), out of their agents' images.

    With a stream some are taken from another camera than the one that shows most. Return a crop of each sighting, or
    None where the images show too little of it.
    """
    found: list[ResizedCrop | None] = [None] * len(seen)
    for number, member in np.unique(np.column_stack([seen.scene, seen.agent]), axis=0):
        scene = clip.scenes[number]
        rows = np.flatnonzero((seen.scene == number) & (seen.agent == member))
        if scene.pixels is None or not scene.agents[member].pictures:
            continue
        at = {int(identity): k for k, identity in enumerate(scene.object_id)}
        pixels = scene.pixels[[at[int(identity)] for identity in seen.identity[rows]], member]
        cut = _cut(scene.agents[member], Boxes3D.from_array(seen.boxes[rows]), pixels, edge_px, margin, rng)
        for row, crop in zip(rows, cut, strict=True):
            found[row] = crop
    return found


def changed(crop: ResizedCrop, rng: np.random.Generator) -> ResizedCrop:
    """Return a crop in another light, sometimes mirrored, sometimes partly covered."""
    light = rng.uniform(0.75, 1.3) * rng.uniform(0.93, 1.07, (3, 1, 1))
    made = np.clip(crop * light + rng.uniform(-8, 8), 0, 255).astype(np.uint8)
    if rng.random() < _MIRRORED:
        made = made[:, :, ::-1].copy()
    if rng.random() < _COVERED:
        edge = crop.shape[1]
        width, height = (rng.uniform(0.15, 0.5, 2) * edge).astype(int)
        left, top = int(rng.integers(0, edge - width)), int(rng.integers(0, edge - height))
        row, column = rng.integers(0, edge, 2)
        made[:, top : top + height, left : left + width] = made[:, row, column][:, None, None]
    return made


def _cut(
    agent: AgentScene,
    boxes: Boxes3D,
    pixels: NDArray[np.int64],
    edge_px: int,
    margin: float,
    rng: np.random.Generator | None,
) -> list[ResizedCrop | None]:
    """Cut boxes (N) out of an agent's images; `pixels` (N,) are those of each object in all of them."""
    cameras = {str(k): picture.calibration for k, picture in enumerate(agent.pictures)}
    crops = best_crops(cameras, boxes)
    camera, place_px = crops.camera.copy(), crops.place_px.copy()
    if rng is not None and len(cameras) > 1:
        for number in range(len(cameras)):  # as if the camera that shows most were not there
            mine = np.flatnonzero((crops.camera == number) & (rng.random(len(boxes)) < _OTHER_CAMERA))
            if len(mine):
                others = {name: each for name, each in cameras.items() if name != str(number)}
                second = best_crops(others, boxes[mine])
                known = second.known
                camera[mine[known]] = second.camera[known] + (second.camera[known] >= number)
                place_px[mine[known]] = second.place_px[known]
    area = (place_px[:, 2:] - place_px[:, :2]).prod(axis=1)
    shown = (camera >= 0) & (pixels >= LEAST_SHOWN * np.where(camera >= 0, area, 0.0))
    found: list[ResizedCrop | None] = [None] * len(boxes)
    for number, picture in enumerate(agent.pictures):
        rows = np.flatnonzero(shown & (camera == number))
        if len(rows):
            cut = cut_crops(picture.rgb, place_px[rows], edge_px, margin).round().clamp(0, 255).to(torch.uint8)
            for row, crop in zip(rows, cut.numpy(), strict=True):
                found[row] = crop
    return found
