from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.clips import SMALL

from coopsim.learn.clips.world import draw_cameras
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.sensors.camera.camera import RIG_HEADINGS_RAD, Rig, rig
from coopsim.support.rng import stream

RIGS = WorldRecipe(cameras={"surround": 0.6, "surround_6": 0.2, "front": 0.2})


def _draw(recipe: WorldRecipe, seed: int) -> dict[str, Rig]:
    return draw_cameras(recipe, lambda purpose: stream(seed, purpose))


def test_rigs_are_as_frequent_as_asked_and_mounted_within_the_ranges() -> None:
    drawn = [_draw(replace(RIGS, distorted_share=0.0), seed) for seed in range(50)]
    assert 0.45 < np.mean([len(rigs["cav"]) == 4 for rigs in drawn]) < 0.75
    assert {len(rigs["cav"]) for rigs in drawn} == {1, 4, 6}
    openings, turns = [], []
    for camera in (camera for rigs in drawn for camera in rigs["cav"]):
        openings.append(np.degrees(2 * np.arctan(160 / camera.intrinsics.fx_px)))
        headings = [named[camera.name] for named in RIG_HEADINGS_RAD.values() if camera.name in named]
        turns.append(np.degrees(camera.yaw_rad - headings[0]))
        assert abs(np.degrees(camera.pitch_rad)) <= 3 and 0.05 <= camera.above_m <= 0.4
    assert min(openings) >= 89.99 and max(openings) <= 110.01 and np.ptp(openings) > 15
    assert min(turns) >= -10.01 and max(turns) <= 10.01 and np.ptp(turns) > 15


def test_agents_of_a_clip_differ_in_the_pitch_of_their_kind_alone() -> None:
    rigs = _draw(RIGS, 3)
    assert rigs["cav"]
    for kind, pitch_deg in (("rsu", 20), ("drone", 45)):
        for car, other in zip(rigs["cav"], rigs[kind], strict=True):
            assert np.isclose(other.pitch_rad - car.pitch_rad, np.radians(pitch_deg))
            assert replace(other, pitch_rad=car.pitch_rad) == car


def test_distorting_lenses_show_the_angle_that_was_drawn_and_fold_nothing() -> None:
    recipe = replace(RIGS, cameras={"front": 1.0}, distorted_share=1.0, camera_fov_deg=(110.0, 110.0))
    for seed in range(10):
        (camera,) = _draw(recipe, seed)["cav"]
        k1, k2, p1, p2, k3 = camera.intrinsics.distortion
        assert -0.25 <= k1 <= -0.05 and 0 <= k2 <= 0.05 and max(abs(p1), abs(p2)) <= 0.002 and k3 == 0
        middle = camera.intrinsics.rays.reshape(180, 320, 3)[90, -1]  # refuses a lens that folds the picture over
        assert np.degrees(np.arctan(middle[0])) == pytest.approx(55, abs=0.6)
    distorting = [_draw(RIGS, seed)["cav"][0].intrinsics.distorts for seed in range(100)]
    assert 0.1 < np.mean(distorting) < 0.3


def test_validation_sees_by_the_named_rig_and_old_recipes_see_nothing() -> None:
    rigs = _draw(WorldRecipe.for_validation(cameras={"surround": 1}), 7)
    assert rigs == {kind: rig("surround", kind) for kind in ("cav", "rsu", "drone")}
    assert WorldRecipe.for_validation().times_of_day == {"day": 1.0}
    assert _draw(SMALL, 0) == {}
