from __future__ import annotations

import warnings

import numpy as np
from helpers.clips import SMALL, require_same

import coopsim
from coopsim.learn.clip_world import draw_world
from coopsim.learn.rollout import SimulatedClips
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks


def test_a_clip_is_the_same_alone_and_after_others() -> None:
    alone = SimulatedClips(SMALL, seed=3).clip(5)
    clips = SimulatedClips(SMALL, seed=3)
    other = clips.clip(2)
    require_same(clips.clip(5), alone)
    assert other.key != alone.key
    assert SimulatedClips(SMALL, seed=4).clip(5).key != alone.key


def test_objects_and_returns_are_those_of_the_environment() -> None:
    """The parts that clips are made of give the frames of an environment with the same options."""
    from dataclasses import replace

    recipe = replace(
        SMALL, start_s=(0.0, 0.0), rain_share=0.0, fog_share=0.0, density=(1.0, 1.0), lidars={"HDL-32E": 1}
    )
    drawn = draw_world(recipe, 0, 1)
    numbers = drawn.scenario.population
    env = coopsim.parallel_env(
        "town",
        place_seed=drawn.scenario.place_seed,
        junctions=1,
        detail=drawn.scenario.detail,
        lidar=drawn.lidar,
        detector="none",
        uplink="none",
        expose_ground_truth=True,
        dt_s=drawn.dt_s,
        connected_cars=2,
        rsus=1,
        truck_share=numbers.truck_share,
        buses=numbers.buses,
        max_cycles=2,
        seed=drawn.seed,
    )
    clip = SimulatedClips(recipe, 0).clip(1)
    observations, infos = env.reset()
    for scene in clip.scenes:
        state = env.state()[: len(scene.object_id)]
        assert (state[:, 0] == scene.object_id).all() and (state[:, 1] == scene.label).all()
        assert (state[:, 2:9] == scene.boxes).all() and (state[:, 9:] == scene.velocity).all()
        row = {int(one): k for k, one in enumerate(scene.object_id)}
        for column, agent in enumerate(scene.agents):
            sweep = observations[agent.name]["sweeps"]["lidar"]
            assert np.abs(sweep[:, :4] - agent.points).max() < 0.006
            assert (infos[agent.name]["true_pose"] == agent.xyz_yaw).all()
            assert infos[agent.name]["actor_id"] == agent.actor_id
            assert (observations[agent.name]["odometry"] == agent.odometry).all()
            truth = infos[agent.name]["ground_truth"]
            for one, returns in zip(truth["id"], truth["returns"], strict=True):
                assert scene.returns[row[int(one)], column] == returns[column]
            if agent.actor_id is not None:
                assert scene.returns[row[agent.actor_id], column] == 0
        if scene is not clip.scenes[-1]:
            nothing = {"tracks": pack_tracks(Tracks.empty())}
            observations, _, _, _, infos = env.step(dict.fromkeys(env.agents, nothing))


def test_crowds_that_do_not_fit_warn_nobody() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        SimulatedClips(SMALL.with_frames(1)).clip(0)
