"""Clips to test with."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from coopsim.learn.clips.clip import Clip, Picture
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world_recipe import WorldRecipe

SMALL = WorldRecipe(frames=2, cars=(2, 2), masts=(1, 1), junctions=1, drone_share=0.0, start_s=(1.0, 1.0))
SEEING = replace(SMALL, cameras={"front": 1.0}, distorted_share=0.0)


def require_same(first: Clip, second: Clip) -> None:
    """Require two clips to be equal, bit by bit."""
    assert (first.key, first.dt_s, len(first.scenes)) == (second.key, second.dt_s, len(second.scenes))
    for one, other in zip(first.scenes, second.scenes, strict=True):
        assert one.time_ns == other.time_ns
        for name in ("object_id", "boxes", "velocity", "label", "returns"):
            _require_same_array(getattr(one, name), getattr(other, name))
        assert (one.pixels is None) == (other.pixels is None)
        if one.pixels is not None and other.pixels is not None:
            _require_same_array(one.pixels, other.pixels)
        for mine, yours in zip(one.agents, other.agents, strict=True):
            assert (mine.name, mine.kind, mine.actor_id) == (yours.name, yours.kind, yours.actor_id)
            for name in ("xyz_yaw", "odometry", "points"):
                _require_same_array(getattr(mine, name), getattr(yours, name))
            for picture, its in zip(mine.pictures, yours.pictures, strict=True):
                require_same_picture(picture, its)


def require_same_picture(one: Picture, other: Picture) -> None:
    """Require two pictures to be equal, bit by bit."""
    assert one.calibration.size == other.calibration.size
    for name in ("matrix", "distortion"):
        _require_same_array(getattr(one.calibration, name), getattr(other.calibration, name))
    for name in ("rotation", "translation"):
        poses = one.calibration.base_SE3_camera, other.calibration.base_SE3_camera
        _require_same_array(getattr(poses[0], name), getattr(poses[1], name))
    for name in ("rgb", "depth_m", "label"):
        _require_same_array(getattr(one, name), getattr(other, name))


def _require_same_array(one: np.ndarray, other: np.ndarray) -> None:
    assert one.dtype == other.dtype and one.shape == other.shape
    assert np.ascontiguousarray(one).tobytes() == np.ascontiguousarray(other).tobytes()


@cache
def small_clip() -> Clip:
    """Return a clip of two frames with two cars and a mast."""
    return SimulatedClips(SMALL).clip(0)


@cache
def seeing_clip() -> Clip:
    """Return a clip of two frames with two cars and a mast, each with a camera."""
    return SimulatedClips(SEEING).clip(0)
