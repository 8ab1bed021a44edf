from __future__ import annotations

from dataclasses import replace

import numpy as np
from helpers.clips import SMALL, small_clip

from coopsim.learn.clips.simulated import SimulatedClips


def test_points_are_in_the_base_frame_of_their_agent() -> None:
    """Returns of an object, as counted, are as many points in its box, seen from the agent's true pose."""
    scene = small_clip().scenes[-1]
    compared = 0
    for column, agent in enumerate(scene.agents):
        assert agent.points.dtype == np.float32 and agent.points.shape[1] == 4
        x, y, _, yaw = agent.xyz_yaw
        cos, sin = np.cos(yaw), np.sin(yaw)
        at = np.column_stack([cos * agent.points[:, 0] - sin * agent.points[:, 1] + x,
                              sin * agent.points[:, 0] + cos * agent.points[:, 1] + y])  # fmt: skip
        for box, returns in zip(scene.boxes, scene.returns[:, column], strict=True):
            if returns < 50:
                continue
            apart = at - box[:2]
            along = apart @ [np.cos(box[6]), np.sin(box[6])]
            across = apart @ [-np.sin(box[6]), np.cos(box[6])]
            above = agent.points[:, 2] + agent.xyz_yaw[2] > box[2] - box[5] / 2 + 0.05
            inside = (np.abs(along) < box[3] / 2 + 0.2) & (np.abs(across) < box[4] / 2 + 0.2) & above
            assert 0.6 * returns < inside.sum() < 1.5 * returns + 20
            compared += 1
    assert compared >= 3


def test_masts_have_no_motion_and_a_lone_car_is_an_object_that_it_does_not_see() -> None:
    scenes = small_clip().scenes
    assert all((scene.agents[2].odometry == 0).all() for scene in scenes) and scenes[0].agents[2].kind == "rsu"
    lone = SimulatedClips(replace(SMALL, cars=(1, 1), masts=(0, 0), dt_s=(1.0,))).clip(0).scenes[1]
    (car,) = lone.agents
    (row,) = np.flatnonzero(lone.object_id == car.actor_id)
    assert np.abs(lone.boxes[row, :2] - car.xyz_yaw[:2]).max() < 1e-9 and (lone.returns[row] == 0).all()
    moved = np.hypot(*lone.velocity[row])
    assert abs(np.hypot(*car.odometry[:2]) - moved) < 2.5  # over a second
