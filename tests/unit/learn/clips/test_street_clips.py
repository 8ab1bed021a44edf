"""Clips in streets as they are, and with traffic on the left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clips import SMALL, require_same

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.learn.clips import world as drawing
from coopsim.learn.clips.left_hand import in_mirror
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world import draw_world
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.recordings.recorded_scene import count_points_in
from coopsim.world.world import BYSTANDER_ID

STREET = replace(SMALL, street_share=1.0)


def test_by_default_no_clip_is_in_a_street_or_in_a_mirror_and_the_rest_stays_the_same() -> None:
    assert WorldRecipe().street_share == WorldRecipe().left_hand_share == 0.0
    usual, other = (draw_world(replace(SMALL, street_share=s, left_hand_share=s), 0, 3) for s in (0.0, 1.0))
    assert (usual.scenario.detail != "street", usual.is_left_hand) == (True, False)
    assert (other.scenario.detail, other.is_left_hand) == ("street", True)
    for name in ("seed", "dt_s", "start_s", "lidar", "weather"):
        assert getattr(usual, name) == getattr(other, name)
    assert usual.scenario.place_seed == other.scenario.place_seed
    assert replace(usual.scenario.population, parked=0) == other.scenario.population


def test_half_of_the_clips_are_in_streets_and_half_in_mirrors_independently(monkeypatch: pytest.MonkeyPatch) -> None:
    details: list[str] = []
    monkeypatch.setattr(drawing, "_scenario", lambda *arguments: details.append(arguments[-1]))
    recipe = replace(SMALL, street_share=0.5, left_hand_share=0.5, plain_share=0.5)
    left = np.array([draw_world(recipe, 0, index).is_left_hand for index in range(400)])
    street = np.array(details) == "street"
    assert 0.42 < street.mean() < 0.58 and 0.42 < left.mean() < 0.58
    assert 0.15 < (street & left).mean() < 0.35
    assert 0.15 < (np.array(details) == "plain").mean() < 0.35


def test_a_clip_of_a_street_labels_bystanders_whose_points_are_in_their_boxes() -> None:
    scene = SimulatedClips(STREET, 0).clip(0).scenes[0]
    resting = scene.object_id >= BYSTANDER_ID
    assert resting.sum() > 30 and not scene.velocity[resting].any()
    seen = resting & (scene.returns[:, 0] >= 5)
    assert seen.sum() >= 3
    agent = scene.agents[0]
    boxes = Boxes3D.from_array(scene.boxes).transform(SE3.from_xyz_yaw(agent.xyz_yaw[:3], agent.xyz_yaw[3]).inverse())
    inside = count_points_in(boxes, [agent.points[:, :3].astype(np.float64)])
    assert (inside[seen] >= 0.7 * scene.returns[seen, 0]).all()


def test_left_hand_clips_are_the_others_in_a_mirror() -> None:
    right = SimulatedClips(SMALL, 0).clip(1)
    left = SimulatedClips(replace(SMALL, left_hand_share=1.0), 0).clip(1)
    require_same(in_mirror(right), replace(left, key=right.key))
    one, other = right.scenes[0], left.scenes[0]
    assert np.array_equal(one.returns, other.returns) and np.array_equal(one.boxes[:, 3:6], other.boxes[:, 3:6])
    assert np.allclose(other.velocity, one.velocity * [1, -1])
    moving = np.hypot(*other.velocity.T) > 2.0
    course = np.arctan2(other.velocity[moving, 1], other.velocity[moving, 0])
    assert moving.any() and (np.cos(course - other.boxes[moving, 6]) > 0.8).all()


def test_in_a_mirror_points_of_an_agent_stay_on_the_same_objects_in_the_world() -> None:
    scene = SimulatedClips(replace(SMALL, left_hand_share=1.0), 0).clip(1).scenes[1]
    for agent in scene.agents:
        world_SE3_base = SE3.from_xyz_yaw(agent.xyz_yaw[:3], agent.xyz_yaw[3])
        boxes = Boxes3D.from_array(scene.boxes).transform(world_SE3_base.inverse())
        inside = count_points_in(boxes, [agent.points[:, :3].astype(np.float64)])
        returns = scene.returns[:, scene.agents.index(agent)]
        assert (returns >= 20).any() and (inside[returns >= 20] >= 0.8 * returns[returns >= 20]).all()


def test_two_mirrors_undo_each_other() -> None:
    clip = SimulatedClips(SMALL, 0).clip(1)
    require_same(in_mirror(in_mirror(clip)), clip)


def test_images_are_not_mirrored() -> None:
    with pytest.raises(InvalidValueError, match=r"left_hand_share must be 0 with cameras, got 0\.5"):
        replace(SMALL, cameras={"front": 1.0}, left_hand_share=0.5)
