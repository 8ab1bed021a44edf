"""The cloud that a teacher of a fusion sees: the points of all agents, now and without errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.samples.sample_frames import mirror, moved, sweeps_of
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.detector.pillars import PillarBatch, collate, pillarize
from coopsim.types import BevGrid


def merged_cloud(
    clip: Clip, number: int, members: Sequence[int], frame: Floats, grid: BevGrid, *, sweeps: int, mirrored: bool
) -> PillarBatch:
    """Return what a teacher sees: the points of all members in a scene, moved without error.

    Args:
        clip: the scenes.
        number: of the scene.
        members: numbers of the agents.
        frame: (4,) pose of the result's frame.
        grid: of the features that the teacher makes of it.
        sweeps: see `sweeps_of`.
        mirrored: the frame is seen in a mirror.
    """
    agents = clip.scenes[number].agents
    points = np.concatenate(
        [moved(sweeps_of(clip, number, each, sweeps), agents[each].xyz_yaw, frame) for each in members]
    )
    if mirrored:
        mirror(points, np.zeros((0, 7)), np.zeros((0, 2)))
    return collate([pillarize(points, BevGrid(grid.x_m, grid.y_m, grid.cell_m / STRIDE))])
