"""Visibility in the environment: told where the truth is told, and the same as what scores are split by."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_env import SIMULATED
from test_environments import play

import coopsim
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics

Make = Callable[..., Any]

TRUTH: dict[str, Any] = {"expose_ground_truth": True, "expose_visibility": True}


@pytest.mark.parametrize("name", SIMULATED)
@pytest.mark.parametrize("ground_truth", ["visible", "all"])
def test_who_saw_an_object_follows_from_the_returns(make_small: Make, name: str, ground_truth: str) -> None:
    env = make_small(name, **TRUTH, ground_truth=ground_truth, lidar_range_m=40.0)
    _, infos = env.reset(seed=2)
    columns = {agent: [info["visibility"][name] for name in ("id", "returns")] for agent, info in infos.items()}
    returns = {agent: dict(zip(*both, strict=True)) for agent, both in columns.items()}
    groups = set()
    for agent, info in infos.items():
        truth = info["ground_truth"]
        for k, actor in enumerate(truth["id"]):
            others = any(returns[other].get(actor, 0) for other in returns if other != agent)
            expected = 0 if returns[agent][actor] else 1 if others else 2
            assert truth["visible_to"][k] == expected
            assert truth["returns"][k].tolist() == [returns[each].get(actor, 0) for each in env.possible_agents]
            assert truth["seen_by"][k].tolist() == [returns[each].get(actor, 0) > 0 for each in env.possible_agents]
            if truth["counts"][k]:
                groups.add(expected)
    assert groups == ({0, 1} if ground_truth == "visible" else {0, 1, 2})


def test_visibility_covers_every_actor_but_oneself_in_every_frame(make_small: Make) -> None:
    env = make_small(**TRUTH, max_cycles=3)
    history = play(env, seed=2)
    for infos in (frame[-1] for frame in history):
        for info in infos.values():
            seen = info["visibility"]
            assert len(seen["id"]) in (17, 18)  # of ten vehicles and eight people; a car does not look at itself
            assert all(len(column) == len(seen["id"]) for column in seen.values())
            assert (seen["returns"] <= np.rint(seen["visible"] * seen["rays"])).all()  # drop-out takes some
            assert set(seen["occluder"]) <= {-1, 0, *env.state()[:, 0].astype(int).tolist()}


def test_it_is_told_only_where_it_was_asked_for(make_small: Make) -> None:
    for options in ({}, {"expose_ground_truth": True}):
        _, infos = make_small(**options).reset(seed=2)
        assert all("visibility" not in info for info in infos.values())
    with pytest.raises(InvalidValueError, match=r"expose_visibility .* needs expose_ground_truth=True"):
        make_small(expose_visibility=True)


def test_without_a_lidar_lines_of_sight_tell_who_saw_what(make_small: Make) -> None:
    _, infos = make_small(lidar=None, **TRUTH, ground_truth="all").reset(seed=2)
    assert all("visibility" not in info for info in infos.values())
    assert {seen_by for info in infos.values() for seen_by in info["ground_truth"]["visible_to"]} >= {0, 1}


TINY = Camera("front", Intrinsics.from_fov(48, 27))
CAMERAS: dict[str, Any] = {"cameras": {"cav_0": [TINY], "rsu_0": [TINY]}, "renderer": "raycast"}


@pytest.mark.parametrize("lidar", [None, "VLP-16"])
def test_pixels_are_told_of_who_has_cameras_where_pictures_tell_actors_apart(make_small: Make, lidar: Any) -> None:
    modes = ("rgb", "instance")
    env = make_small(**TRUTH, max_cycles=2, lidar=lidar, camera_modes=modes, **CAMERAS)
    for infos in (frame[-1] for frame in play(env, seed=2)):
        for agent, info in infos.items():
            assert ("pixel_visibility" in info) == (agent in ("cav_0", "rsu_0"))
        for agent in ("cav_0", "rsu_0"):
            seen, picture = infos[agent]["pixel_visibility"], infos[agent]["segmentation"]["front"]["instance"]
            shown = [(picture == actor).sum() for actor in seen["id"]]
            np.testing.assert_array_equal(np.rint(seen["pixels"] * seen["visible"]), shown)


def test_pixels_are_told_only_where_they_are_asked_for(make_small: Make) -> None:
    for options in (TRUTH, {**TRUTH, **CAMERAS}, CAMERAS):
        _, infos = make_small(**options).reset(seed=2)
        assert all("pixel_visibility" not in info for info in infos.values())


def test_cooperation_gains_what_only_others_see(make_small: Make) -> None:
    groups = {}
    for policy in ("no_fusion", "late_fusion"):
        env = make_small(lidar="HDL-32E", lidar_columns=512, vehicles=20, max_cycles=20)
        play(env, seed=0, policy=policy)
        score = env.score()
        groups[policy] = score.visibility
        found = sum(agent.all_tracks["TP"] for agent in score.agents.values())
        assert sum(group.tp for group in score.visibility.values()) == found
    alone, together = groups["no_fusion"], groups["late_fusion"]
    assert alone["others only"].gt == together["others only"].gt > 0
    assert together["others only"].recall > alone["others only"].recall + 10


def test_the_truth_has_velocities_poses_and_ids_for_training(make_small: Make) -> None:
    env = make_small(expose_ground_truth=True, position_noise_m=0.5, max_cycles=2, region_x_m=20.0)
    masks = []
    for begin in (lambda: env.reset(seed=2), lambda: play(env, seed=2)[-1]):
        infos = begin()[-1]
        state = env.state()
        world = {int(row[0]): row for row in state if row[0]}
        for agent, info in infos.items():
            truth, pose = info["ground_truth"], SE3.from_xyz_yaw(info["true_pose"][:3], info["true_pose"][3])
            assert len(truth["id"]) == len(world) - (info["actor_id"] is not None)
            inside = (np.abs(truth["box"][:, :2]) <= [20, 40]).all(axis=1)
            np.testing.assert_array_equal(truth["in_region"], inside)
            masks.append(inside)
            for k, identity in enumerate(truth["id"]):
                np.testing.assert_allclose(pose.apply(truth["box"][k, :3]), world[int(identity)][2:5], atol=1e-9)
                velocity = pose.rotate_planar(truth["velocity"][k : k + 1])[0]
                np.testing.assert_allclose(velocity, world[int(identity)][9:11], atol=1e-9)
            if info["actor_id"] is None:
                assert agent == "rsu_0"
            else:
                np.testing.assert_allclose(world[info["actor_id"]][2:4], info["true_pose"][:2], atol=1e-9)
                assert info["actor_id"] not in truth["id"]
    assert 0 < np.concatenate(masks).mean() < 1


def test_a_recording_tells_what_it_knows(recordings: Path) -> None:
    env = coopsim.parallel_env("replay", path=recordings, detections=("ego", "1"), expose_ground_truth=True)
    _, infos = env.reset()
    truth = infos["ego"]["ground_truth"]
    assert set(truth) == {"id", "box", "label", "in_region", "counts"} and truth["counts"].tolist() == [True]
