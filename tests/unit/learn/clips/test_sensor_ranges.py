"""Ranges of sensors and ground by recipe, and what they change in a clip."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from clips import SMALL, require_same

from coopsim.config.load import load
from coopsim.errors import CoopsimError
from coopsim.learn.clips.realism import draw_realism, realistic_lidar
from coopsim.learn.clips.sensor_ranges import SensorRanges
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world import draw_world
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.sensors.lidar.imperfections import Imperfections
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.support.rng import stream

REAL = replace(SMALL, realistic_share=1.0)
WIDE = {
    "gain": (0.1, 2.0),
    "gamma": (0.4, 1.6),
    "offset": (0.0, 0.05),
    "fade": (-0.5, 1.0),
    "lost_share": (0.1, 0.25),
    "bloom_rad": (0.001, 0.004),
}


def test_without_ranges_clips_and_their_names_stay_the_same() -> None:
    assert "sensors" not in repr(REAL) and repr(REAL).endswith("allow_test_places=False)")
    assert eval(repr(REAL)) == REAL
    assert repr(replace(REAL, sensors=SensorRanges(gain=(0.5, 1.0)))) != repr(REAL)
    one = replace(REAL, frames=1, cars=(1, 1), masts=(0, 0))
    unused = SimulatedClips(replace(one, sensors=SensorRanges())).clip(1)
    usual = SimulatedClips(one).clip(1)
    require_same(replace(unused, key=usual.key), usual)


def rng_of(index: int) -> Callable[[str], np.random.Generator]:
    return lambda purpose: stream(0, purpose, "clip", str(index))


def built(index: int = 0, **ranges: Any) -> Imperfections:
    lidar = realistic_lidar(LidarConfig(), rng_of(index)("lidar as built"))
    flaws = SensorRanges(**ranges).built(lidar, rng_of(index)).imperfections
    assert flaws is not None
    return flaws


def test_values_lie_in_their_ranges_and_one_range_changes_no_other_value() -> None:
    usual = built()
    for index in range(20):
        flaws = built(index, **WIDE)
        assert all(low <= getattr(flaws, name) <= high for name, (low, high) in WIDE.items())
    for name, ends in WIDE.items():
        alone = built(**{name: ends})
        assert getattr(alone, name) == getattr(built(**WIDE), name) != getattr(usual, name)
        assert replace(alone, **{name: getattr(usual, name)}) == usual


def test_factors_are_drawn_by_their_logarithms() -> None:
    assert -2.7 < np.mean([math.log(built(index, gain=(0.01, 1.0)).gain) for index in range(200)]) < -1.9


def test_lidars_are_as_high_as_drawn_except_on_higher_bodies() -> None:
    world = draw_world(replace(REAL, sensors=SensorRanges(mount_m=(1.8, 1.8))), 0, 0)
    above_m = world.lidar.above_m
    assert world.under_lidar_m("cav", 1.4) + above_m == pytest.approx(1.8)
    assert world.under_lidar_m("cav", 2.6) + above_m == pytest.approx(2.6 + min(above_m, 0.15))
    assert world.under_lidar_m("rsu", 5.0) == 5.0


def test_the_lidar_of_a_clip_is_where_it_was_drawn_and_sees_its_car() -> None:
    """The lower a LiDAR, the farther away the shadow of its own car ends."""
    recipe = replace(REAL, frames=1, cars=(1, 1), masts=(0, 0))

    def points(**ranges: Any) -> np.ndarray:
        return SimulatedClips(replace(recipe, sensors=SensorRanges(**ranges))).clip(0).scenes[0].agents[0].points

    def nearest_m(points: np.ndarray) -> float:
        return float(np.percentile(np.linalg.norm(points[np.abs(points[:, 2]) < 0.3, :2], axis=1), 0.5))

    def on_car(points: np.ndarray) -> int:
        return int(((np.abs(points[:, :2]) < [2.0, 0.7]).all(axis=1) & (points[:, 2] > 0.6)).sum())

    low, high = points(mount_m=(1.7, 1.7)), points(mount_m=(2.3, 2.3))
    assert nearest_m(low) > nearest_m(high) + 0.3
    assert on_car(points(mount_m=(1.7, 1.7), ego_share=1.0)) > 20 > on_car(low)


def test_the_ground_is_as_steep_and_rough_as_drawn() -> None:
    places = np.random.default_rng(0).uniform(-30, 30, (2000, 2))
    smooth, rough = (draw_realism(0, 0, 0.0, each).ground.heights(places).std() for each in (16e-6, 16e-4))
    assert rough == pytest.approx(10 * smooth, rel=0.01)
    ahead = places + np.array([0.5, 0.0])
    steep, usual = (draw_realism(0, 0, grade, 1e-7).ground for grade in (0.1, None))
    rises = [np.abs(ground.heights(ahead) - ground.heights(places)).max() / 0.5 for ground in (steep, usual)]
    assert 0.02 < rises[0] < 0.11 and rises[1] < rises[0]


def test_a_recipe_names_them_and_wrong_ones_are_refused() -> None:
    world = load(WorldRecipe, {"sensors": {"gain": [0.1, 2], "ego_share": 1}}, "world")
    assert world.sensors == SensorRanges(gain=(0.1, 2.0), ego_share=1.0)
    for wrong, said in (
        ({"gain": [2, 1]}, "gain"),
        ({"fade": [0, 9]}, "fade"),
        ({"gains": [1, 2]}, "Did you mean 'gain'"),
        ({"ego_share": 2}, "ego_share"),
        (3, "sensors must be a"),
    ):
        with pytest.raises(CoopsimError, match=said):
            load(WorldRecipe, {"sensors": wrong}, "world")
