"""Clips with sweeps as on real roads: what is drawn, and what it does to points, boxes and poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clips import SMALL, require_same

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.realism import Ground, draw_realism
from coopsim.learn.clips.simulated import ClipSensing, SimulatedClips
from coopsim.learn.clips.world import draw_world
from coopsim.sensors.scene import SceneGeometry
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.snapshot import Actors
from coopsim.world.world import World

REAL = replace(SMALL, realistic_share=1.0)


def test_by_default_no_clip_has_them_and_a_share_of_0_changes_no_bit() -> None:
    assert SMALL.realistic_share == 0.0
    drawn = [draw_world(replace(SMALL, realistic_share=share), 0, 3) for share in (0.0, 1.0)]
    assert drawn[0].realism is None and drawn[0].lidar.imperfections is None
    assert drawn[1].realism is not None and drawn[1].lidar.imperfections is not None
    assert drawn[0].seed == drawn[1].seed and drawn[0].scenario.population == drawn[1].scenario.population


def test_the_share_of_clips_is_about_that_asked_for() -> None:
    recipe = replace(SMALL, realistic_share=0.6)
    real = [draw_world(recipe, 0, index).realism is not None for index in range(12)]
    assert 0.35 < np.mean(real) < 0.85


def test_a_seed_gives_the_same_bits() -> None:
    require_same(SimulatedClips(REAL, 1).clip(2), SimulatedClips(REAL, 1).clip(2))


def test_ground_is_smooth_repeats_and_is_as_rough_as_drawn() -> None:
    places = np.random.default_rng(0).uniform(-300, 300, (4000, 2))
    for index in range(6):
        ground = draw_realism(0, index).ground
        rise = ground.heights(places + np.array([0.2, 0.0])) - ground.heights(places)
        assert np.abs(rise).max() / 0.2 < 0.35  # no steps
        np.testing.assert_allclose(
            ground.heights(places + np.array([512.0, -512.0])), ground.heights(places), atol=1e-5
        )
    wave = Ground(np.array([[4, 0]]), np.array([0.0]), np.array([0.5]))
    np.testing.assert_allclose(
        wave.heights(np.array([[32.0, 7.0], [64.0, 0.0], [96.0, 3.0]])), [0.5, 0, -0.5], atol=1e-3
    )


def test_boxes_poses_and_points_are_lifted_by_the_same_ground() -> None:
    """Against the same clip on flat ground: all heights differ by those of the ground, and nothing else does."""
    drawn = draw_world(REAL, 0, 0)
    assert drawn.realism is not None
    level = Ground(np.zeros((1, 2), np.int64), np.zeros(1), np.zeros(1))
    hilly, flat = (
        ClipSensing(replace(drawn, realism=realism), World(drawn.scenario, drawn.seed)).sense(0)
        for realism in (drawn.realism, replace(drawn.realism, ground=level))
    )
    heights = drawn.realism.ground.heights
    np.testing.assert_allclose(hilly.boxes[:, 2] - flat.boxes[:, 2], heights(flat.boxes[:, :2]), atol=1e-9)
    assert np.ptp(heights(flat.boxes[:, :2])) > 0.05
    for agent, same in zip(hilly.agents, flat.agents, strict=True):
        pose = SE3.from_xyz_yaw(same.xyz_yaw[:3], same.xyz_yaw[3])
        there = heights(pose.apply(same.points[:, :3])[:, :2])
        rise = agent.points[:, 2] + agent.xyz_yaw[2] - same.points[:, 2] - same.xyz_yaw[2]
        np.testing.assert_allclose(rise, there, atol=0.02)  # points are rounded to centimetres
        np.testing.assert_array_equal(agent.points[:, [0, 1, 3]], same.points[:, [0, 1, 3]])


def test_people_and_cars_keep_their_own_sizes_and_carriers_theirs() -> None:
    first, second = SimulatedClips(REAL).clip(0).scenes
    both, here, there = np.intersect1d(first.object_id, second.object_id, return_indices=True)
    assert len(both) > 3
    np.testing.assert_allclose(first.boxes[here, 3:6], second.boxes[there, 3:6])
    plain = SimulatedClips(SMALL).clip(0).scenes[0]
    both, here, there = np.intersect1d(first.object_id, plain.object_id, return_indices=True)
    ratio = first.boxes[here, 3:6] / plain.boxes[there, 3:6]
    assert ratio.min() > 0.65 and ratio.max() < 1.6 and ratio.std() > 0.02
    carriers = [agent.actor_id for agent in first.agents if agent.actor_id is not None]
    own = np.isin(both, carriers)
    assert own.any()
    np.testing.assert_allclose(ratio[own][:, 2], 1.0)


def test_bodies_are_as_large_as_their_boxes_but_for_the_slack() -> None:
    drawn = draw_world(REAL, 0, 1)
    world = World(drawn.scenario, drawn.seed)
    actors, realism = world.actors(), drawn.realism
    assert realism is not None
    sized, scale = realism.sized(actors, np.zeros(len(actors), np.bool_))
    triangles = SceneGeometry(world.models, world.static).triangles(sized, scale)
    for k in range(len(actors)):
        mine = np.unique(triangles.faces[triangles.instance == actors.id[k]])
        local = (triangles.vertices[mine] - sized.boxes.center[k])[:, :2]
        cos, sin = np.cos(sized.boxes.yaw[k]), np.sin(sized.boxes.yaw[k])
        extent = np.ptp(local @ np.array([[cos, -sin], [sin, cos]]), axis=0)
        assert (extent <= sized.boxes.size[k, :2] + 0.05).all() and (extent > 0.5 * sized.boxes.size[k, :2]).all()


def test_paint_darkens_vehicles_alone() -> None:
    drawn = draw_world(REAL, 0, 1)
    world = World(drawn.scenario, drawn.seed)
    actors, realism = world.actors(), drawn.realism
    assert realism is not None
    before = SceneGeometry(world.models, world.static).triangles(actors)
    after = realism.painted(before, actors)
    label = dict(zip(actors.id.tolist(), actors.label.tolist(), strict=True))
    kind = np.array([label.get(each, -1) for each in before.instance.tolist()])
    on_foot = np.isin(kind, (ObjectClass.PEDESTRIAN, ObjectClass.CHILD, -1))
    np.testing.assert_array_equal(after.reflectivity[on_foot], before.reflectivity[on_foot])
    assert (after.reflectivity <= before.reflectivity + 1e-12).all()
    assert after.reflectivity[~on_foot].mean() < before.reflectivity[~on_foot].mean()


def test_clutter_stands_beside_the_lanes_and_leaves_them_free() -> None:
    plain, real = (draw_world(replace(SMALL, realistic_share=share, plain_share=0.0), 0, 2) for share in (0.0, 1.0))
    before = len(plain.scenario.layout.furnishing)
    added = real.scenario.layout.furnishing[before:]
    assert len(added) > 10
    for lane in real.scenario.layout.network.lanes.values():
        middle = np.array([lane.position(along, 0.0) for along in np.arange(0, min(lane.length, 200), 2.0)])
        for part in added:
            low = part.vertices[part.vertices[:, 2] < 0.5]
            if len(low):
                away = np.linalg.norm(low[:, None, :2] - middle, axis=2).min()
                assert away > lane.width / 2 - 0.2


def test_a_box_of_another_height_stands_where_it_stood() -> None:
    boxes = Boxes3D.from_array(np.array([[1.0, 2.0, 0.75, 4.5, 1.8, 1.5, 0.3], [5.0, 2.0, 0.9, 0.5, 0.6, 1.8, 0.0]]))
    label = np.array([ObjectClass.CAR, ObjectClass.PEDESTRIAN])
    nothing = np.zeros((2, 2))
    actors = Actors(np.array([4, 4_000_000_000]), boxes, nothing, label, np.zeros(2, int), np.zeros((2, 3), np.uint8))
    sized, scale = draw_realism(0, 0).sized(actors, np.zeros(2, np.bool_))
    assert sized.boxes.center[:, 2] - sized.boxes.size[:, 2] / 2 == pytest.approx(0.0)
    assert (scale != 1.0).all()
