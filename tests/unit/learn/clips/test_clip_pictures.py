from __future__ import annotations

import numpy as np
from helpers.clips import seeing_clip

from coopsim.learn.clips.clip import BLOCK, nearest_in_blocks


def test_blocks_keep_their_nearest_surface_and_its_class() -> None:
    rng = np.random.default_rng(5)
    depth = rng.uniform(0.5, 300, (10, 7)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.5] = 0.0
    depth[:4, :4] = 0.0
    label = rng.integers(0, 9, depth.shape).astype(np.uint8)
    label[depth == 0] = 255
    nearest, its = nearest_in_blocks(depth, label, BLOCK)
    assert nearest.shape == its.shape == (3, 2) and its.dtype == np.uint8
    assert (nearest[0, 0], its[0, 0]) == (0, 255)
    for row, column in np.argwhere(nearest > 0):
        block = np.s_[BLOCK * row : BLOCK * (row + 1), BLOCK * column : BLOCK * (column + 1)]
        least = depth[block][depth[block] > 0].min()
        assert nearest[row, column] == least and its[row, column] == label[block][depth[block] == least]
    assert (nearest > 0).sum() == 5


def test_pictures_of_a_clip_have_the_shapes_of_their_cameras() -> None:
    clip = seeing_clip()
    assert clip.scenes
    for scene in clip.scenes:
        assert scene.agents and scene.pixels is not None and scene.pixels.shape == scene.returns.shape
        for column, agent in enumerate(scene.agents):
            (picture,) = agent.pictures
            assert picture.calibration.size == (180, 320)
            assert picture.rgb.shape == (180, 320, 3) and picture.depth_m.shape == picture.label.shape == (45, 80)
            assert len(np.unique(picture.rgb.reshape(-1, 3), axis=0)) > 5
            assert not scene.pixels[scene.object_id == agent.actor_id, column].any()
