"""Visibility in scenes made by hand: who is hidden, how much, and by what."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from sensor_scenes import CAR, MODELS, POST, actors, box_model, box_part, ground, triangles

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.returns import count_returns
from coopsim.sensors.scene import STATIC_ID, RayScene, SceneGeometry
from coopsim.sensors.visibility import NOTHING, Crossings, Visibility, VisibilityProbe, count_crossings
from coopsim.support.rng import stream
from coopsim.world.snapshot import Actors, AgentBody, StaticPart

CONFIG = LidarConfig(columns=2048, dropout_energy=0.0)
TRUCK = (9.0, 2.5, 3.6)


def agent(x_m: float = 0.0, y_m: float = 0.0, *, height_m: float = 1.5, actor_id: int | None = None) -> AgentBody:
    return AgentBody("agent", "cav", actor_id, SE3.from_xyz_yaw([x_m, y_m, 0.0], 0.3), height_m)


def look(who: Actors, body: AgentBody | None = None, static: tuple[StaticPart, ...] = (ground(),)) -> Visibility:
    return look_at(RayScene(triangles(who, static)), who, agent() if body is None else body)


def look_at(scene: RayScene, who: Actors, body: AgentBody, config: LidarConfig = CONFIG) -> Visibility:
    rng = stream(0, "lidar", body.name)
    sweep = Lidar(config).sense(scene, body.world_SE3_base, body.height_m, body.actor_id, rng)
    return VisibilityProbe([config]).measure(scene, body, who, count_returns({"lidar": sweep}, who.id))


def of(seen: Visibility, name: str) -> list[Any]:
    values: list[Any] = getattr(seen, name).tolist()
    return values


def truck_and_pedestrian() -> tuple[RayScene, Actors]:
    models = (box_model(TRUCK), MODELS[1])
    size = np.array([TRUCK, POST])
    center = np.array([[10.0, 0.0, 1.8], [20.0, 0.0, 1.0]])
    kind = np.array([0, 1])
    boxes = Boxes3D(center, size, np.array([np.pi / 2, 0.0]))
    who = Actors(np.array([7, 3]), boxes, np.zeros((2, 2)), kind, kind, np.zeros((2, 3), dtype=np.uint8))
    return RayScene(SceneGeometry(models, (ground(),)).triangles(who)), who


def test_a_truck_hides_a_pedestrian_from_one_agent_and_not_from_the_other() -> None:
    scene, who = truck_and_pedestrian()
    behind, beside = (look_at(scene, who, agent(*place)) for place in ((0.0, 0.0), (20.0, 12.0)))
    assert of(behind, "id") == [7, 3]
    assert of(behind, "visible") == [1.0, 0.0]
    assert of(behind, "occluder") == [NOTHING, 7]
    assert behind.returns[1] == 0 < behind.rays[1]
    assert beside.visible[1] == 1.0 and beside.occluder[1] == NOTHING
    assert beside.returns[1] == beside.rays[1] > 0


def test_scenery_and_the_own_body_hide_as_well() -> None:
    wall = box_part([5.0, 0.0, 2.0], (0.3, 6.0, 4.0))
    hidden = look(actors([[15.0, 0.0, 0.0]]), static=(ground(), wall))
    assert of(hidden, "visible") == [0.0] and of(hidden, "occluder") == [STATIC_ID]
    # The roof, 0.35 m below the sensor, is in the way of what is close beside the car.
    who = actors([[0.0, 0.0, 0.3], [0.0, 2.2, 0.3]], model=[0, 1], first_id=4)
    beside = look(who, agent(actor_id=4, height_m=CAR[2]))
    assert of(beside, "id") == [5]
    assert of(beside, "occluder") == [4] and 0 < beside.visible[0] < 1


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_a_wall_in_front_of_a_part_hides_that_part(share: float) -> None:
    # A car broadside on, 20 m away; half way to it a wall that hides the left part of it.
    who, edge_m = actors([[20.0, 0.0, np.pi / 2]]), CAR[0] * (0.5 - share) / 2 * 19 / 20
    wall = box_part([10.0, edge_m + 5.0, 2.5], (0.01, 10.0, 5.0))
    seen = look(who, static=(ground(), wall))
    assert seen.visible[0] == pytest.approx(1 - share, abs=0.05)
    assert of(seen, "occluder") == [STATIC_ID]


def test_the_occluder_is_who_hides_most() -> None:
    # Two posts before a car: one nearer to the agent, so wider to it.
    who = actors([[20.0, 0.0, np.pi / 2], [8.0, 0.4, 0.0], [14.0, -1.0, 0.0]], model=[0, 1, 1])
    assert look(who).occluder[0] == 2
    assert look(who[np.array([0, 2])]).occluder[0] == 3


def test_alone_means_as_if_nobody_else_was_there() -> None:
    rng = np.random.default_rng(1)
    place = np.column_stack([rng.uniform(-40, 40, (12, 2)), rng.uniform(-3, 3, 12)])
    who = actors(place, model=rng.integers(0, 2, 12))
    building = box_part([12.0, 3.0, 4.0], (6.0, 14.0, 8.0))
    crowd = look(who, static=(ground(), building))
    for k in range(len(who)):
        alone = look(who[k : k + 1], static=(ground(),))
        # Rays that only graze an edge may differ, as what is followed starts anew behind what it met.
        assert crowd.rays[k] == pytest.approx(alone.rays[0], abs=2)
        assert alone.visible[0] == (1.0 if alone.rays[0] else 0.0)
        assert alone.returns[0] == alone.rays[0]
    assert (crowd.visible < 1).any()
    np.testing.assert_array_equal(crowd.returns, np.rint(crowd.visible * crowd.rays))


def test_permuting_and_renaming_actors_permutes_and_renames_visibility() -> None:
    rng = np.random.default_rng(2)
    who = actors(np.column_stack([rng.uniform(-25, 25, (10, 2)), rng.uniform(-3, 3, 10)]))
    order = rng.permutation(10)
    seen, permuted = look(who), look(who[order])
    for name in ("id", "returns", "rays", "visible", "occluder"):
        np.testing.assert_array_equal(getattr(permuted, name), getattr(seen, name)[order])
    assert len(set(of(seen, "occluder"))) > 2


def test_range_ends_visibility() -> None:
    who = actors([[30.0, 0.0, 0.0], [60.0, 10.0, 0.0], [0.9, 0.0, 0.0]], model=[0, 0, 1])
    config = LidarConfig(columns=2048, dropout_energy=0.0, max_range_m=40.0)
    seen = look_at(RayScene(triangles(who)), who, agent(), config)
    assert seen.rays[0] > 0
    assert (seen.rays[1], seen.visible[1], seen.occluder[1]) == (0, 0.0, NOTHING)


def test_returns_fall_with_drop_out_and_rays_do_not() -> None:
    who = actors([[25.0, 5.0, 1.0]])
    scene = RayScene(triangles(who, (ground(),)))
    lossy = look_at(scene, who, agent(), LidarConfig(columns=2048, dropout_energy=0.5))
    whole = look_at(scene, who, agent())
    assert 0 < lossy.returns[0] < whole.returns[0]
    assert of(lossy, "rays") == of(whole, "rays") and of(lossy, "visible") == [1.0]


@pytest.mark.parametrize("place", [[], [[20.0, 0.0, 0.0]]])
def test_a_world_with_nobody_or_nothing(place: ArrayLike) -> None:
    who = actors(place)
    seen = look_at(RayScene(triangles(who, (ground(),))), who, agent())
    assert len(seen.id) == len(who)
    none = np.zeros(0, dtype=np.int64)
    rays, visible, occluder = count_crossings(Crossings(none, none, none), who.id)
    assert (rays == 0).all() and (visible == 0).all() and (occluder == NOTHING).all()


def test_the_rays_of_several_lidars_count_together() -> None:
    who = actors([[20.0, 0.0, 0.0], [12.0, -1.0, 0.0]], model=[0, 1])
    scene, none = RayScene(triangles(who, (ground(),))), np.zeros(2, dtype=np.int64)
    left, right = (LidarConfig(columns=2048, y_m=y_m, yaw_rad=y_m) for y_m in (0.8, -0.8))
    both, one, other = (
        VisibilityProbe(configs).measure(scene, agent(), who, none) for configs in ((left, right), (left,), (right,))
    )
    np.testing.assert_array_equal(both.rays, one.rays + other.rays)
    np.testing.assert_allclose(both.visible * both.rays, one.visible * one.rays + other.visible * other.rays)
