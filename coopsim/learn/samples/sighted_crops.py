"""What agents' pictures show of sightings, as an identity from pictures is trained on it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.learn.clips.clip import AgentScene, Clip
from coopsim.learn.samples.sightings import Sightings
from coopsim.nn.identity.cut_crops import cut_crops
from coopsim.sensors.camera.crops import best_crops

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
    """Cut sightings out of their agents' pictures.

    Args:
        clip: the scenes.
        seen: M sightings; their boxes say where.
        edge_px: E, edge of a resized crop.
        margin: share of width and height around the box.
        rng: takes some sightings from another camera than the one that shows most; None: it takes none.

    Returns:
        Of each sighting its crop; None: its agent's pictures show too little of it.
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
    """Return a crop in another light, sometimes from the other side, sometimes with something before it."""
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
    """Cut boxes (N) out of one agent's pictures; `pixels` (N,) are those of each object in all of them."""
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
