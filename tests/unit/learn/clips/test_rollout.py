from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from helpers.clips import SEEING, SMALL, require_same, require_same_picture, seeing_clip, small_clip

import coopsim
from coopsim.envs.parallel import CooperativeEnv
from coopsim.learn.clips.arrays import round_points
from coopsim.learn.clips.clip import BLOCK, AgentScene, Picture, Scene, nearest_in_blocks
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world import ClipWorld, draw_world
from coopsim.sensors.camera.picture import MODES
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks


def test_a_clip_is_the_same_alone_and_after_others() -> None:
    alone = SimulatedClips(SMALL, seed=3).clip(5)
    clips = SimulatedClips(SMALL, seed=3)
    other = clips.clip(2)
    require_same(clips.clip(5), alone)
    assert other.key != alone.key
    assert SimulatedClips(SMALL, seed=4).clip(5).key != alone.key


def test_cameras_change_nothing_else() -> None:
    blind = [
        replace(scene, pixels=None, agents=tuple(map(_without_pictures, scene.agents)))
        for scene in seeing_clip().scenes
    ]
    assert all(agent.pictures for scene in seeing_clip().scenes for agent in scene.agents)
    require_same(replace(seeing_clip(), key=small_clip().key, scenes=tuple(blind)), small_clip())


def _without_pictures(agent: AgentScene) -> AgentScene:
    return replace(agent, pictures=())


def _environment(drawn: ClipWorld, frames: int, **changed: Any) -> CooperativeEnv:
    """Return an environment that shows the world of a clip."""
    numbers = drawn.scenario.population
    return coopsim.parallel_env(
        "town",
        place_seed=drawn.scenario.place_seed,
        junctions=1,
        detail=drawn.scenario.detail,
        lidar=drawn.lidar,
        weather=drawn.weather,
        detector="none",
        uplink="none",
        expose_ground_truth=True,
        dt_s=drawn.dt_s,
        connected_cars=numbers.connected_cars,
        rsus=numbers.rsus,
        drones=numbers.drones,
        truck_share=numbers.truck_share,
        buses=numbers.buses,
        max_cycles=frames,
        seed=drawn.seed,
        **changed,
    )


def test_clips_show_what_an_environment_of_their_world_shows() -> None:
    recipe = replace(SMALL, start_s=(0.0, 0.0), density=(1.0, 1.0), rain_share=1.0, drone_share=1.0)
    env = _environment(draw_world(recipe, 0, 1), 2)
    observations, infos = env.reset()
    scenes = SimulatedClips(recipe, 0).clip(1).scenes
    assert len(scenes) > 1
    for scene in scenes:
        assert [agent.kind for agent in scene.agents] == ["cav", "cav", "rsu", "drone"]
        assert scene.time_ns == env.time_ns
        rows = np.column_stack([scene.object_id, scene.label, scene.boxes, scene.velocity])
        assert (env.state()[: len(rows)] == rows).all() and not env.state()[len(rows) :].any()
        for column, agent in enumerate(scene.agents):
            _require_shown(agent, scene, column, observations[agent.name], infos[agent.name])
        nothing = {"tracks": pack_tracks(Tracks.empty())}
        observations, _, _, _, infos = env.step(dict.fromkeys(env.agents, nothing))


def _require_shown(
    agent: AgentScene, scene: Scene, column: int, observation: Mapping[str, Any], info: Mapping[str, Any]
) -> None:
    assert (round_points(observation["sweeps"]["lidar"][:, :4]) == agent.points).all()
    assert (observation["odometry"] == agent.odometry).all()
    assert (info["true_pose"] == agent.xyz_yaw).all() and info["actor_id"] == agent.actor_id
    others = scene.object_id != agent.actor_id
    truth = info["ground_truth"]
    assert (truth["id"] == scene.object_id[others]).all() and (truth["returns"][:, column] > 0).any()
    assert (truth["returns"][:, column] == scene.returns[others, column]).all()
    assert (scene.returns[~others, column] == 0).all()


def test_pictures_show_what_an_environment_of_their_world_shows() -> None:
    recipe = replace(SEEING, frames=1, start_s=(0.0, 0.0), density=(1.0, 1.0), rain_share=1.0, distorted_share=1.0)
    drawn = draw_world(recipe, 0, 1)
    (scene,) = SimulatedClips(recipe, 0).clip(1).scenes
    rigs = {agent.name: drawn.cameras[agent.kind] for agent in scene.agents}
    env = _environment(drawn, 1, cameras=rigs, camera_modes=MODES, time_of_day=drawn.time_of_day)
    observations, infos = env.reset()
    assert scene.pixels is not None and scene.pixels.any(axis=0).all()
    for column, agent in enumerate(scene.agents):
        image, truth = observations[agent.name]["cameras"]["front"], infos[agent.name]["segmentation"]["front"]
        depth_m, label = nearest_in_blocks(image["depth"], truth["semantic"], BLOCK)
        calibration = env.agent_specs[agent.name].cameras["front"]
        (picture,) = agent.pictures
        require_same_picture(Picture(calibration, image["rgb"], depth_m.astype(np.float16), label), picture)
        seen = [(truth["instance"] == one).sum() for one in scene.object_id]
        assert (scene.pixels[:, column] == seen).all()
    env.close()


def test_crowds_that_do_not_fit_warn_nobody() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        SimulatedClips(replace(SMALL, frames=1)).clip(0)
