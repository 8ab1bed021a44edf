"""Visibility by pixels: what pictures show, of what they would show of an actor alone, and what hides the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensor_scenes import CAR, Studio, actors, box_part, ground, triangles

from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera, named_rig
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.scene import STATIC_ID, RayScene
from coopsim.sensors.visibility import NOTHING, PixelVisibility, measure_pixels
from coopsim.types import Ints
from coopsim.world.snapshot import Actors, AgentBody, StaticPart

GROUND = (ground(),)
WALLED = (*GROUND, box_part([12.0, 3.0, 2.0], (1.0, 6.0, 4.0)))
BARREL = Intrinsics.from_fov(160, 90, distortion=(-0.25, 0.08, 0.001, -0.002, 0.0))
SMALL = Intrinsics.from_fov(160, 90)


def rig(lens: Intrinsics = SMALL) -> list[Camera]:
    return [replace(camera, intrinsics=lens) for camera in named_rig("surround")]


def body(actor_id: int | None = None) -> AgentBody:
    return AgentBody("cav_0", "cav", actor_id, SE3.identity(), CAR[2])


def look(
    who: Actors, static: tuple[StaticPart, ...] = GROUND, own_id: int | None = None, cameras: list[Camera] | None = None
) -> PixelVisibility:
    return measure_pixels(cameras or rig(), RayScene(triangles(who, static)), body(own_id), who)


def pixels_in_pictures(
    who: Actors, static: tuple[StaticPart, ...], own_id: int | None, cameras: list[Camera], renderer: str = "raycast"
) -> Ints:
    """(N,) pixels that show each actor but the own one."""
    studio = Studio(renderer, static, cameras={"cav_0": cameras}, modes=("instance",))
    pictures = studio.shoot(who, {"cav_0": body(own_id)})["cav_0"].values()
    studio.rig.close()
    shown = np.concatenate([image.instance.ravel() for image in pictures if image.instance is not None])
    return np.array([(shown == actor).sum() for actor in who.id if actor != own_id])


def crowd() -> Actors:
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(-25, 25, (14, 2)), rng.uniform(-3, 3, 14)])
    return actors(np.concatenate([[[0.0, 0.0, 0.0]], places]), model=[0, *rng.integers(0, 2, 14)])


@pytest.mark.parametrize("lens", [SMALL, BARREL])
def test_what_is_visible_is_what_pictures_show(lens: Intrinsics) -> None:
    who, cameras = crowd(), rig(lens)
    seen = look(who, WALLED, 1, cameras)
    assert seen.id.tolist() == list(range(2, 16))  # not itself
    shown = pixels_in_pictures(who, WALLED, 1, cameras)
    np.testing.assert_array_equal(np.rint(seen.pixels * seen.visible), shown)
    assert (seen.visible == 0).any() and ((seen.visible > 0) & (seen.visible < 1)).any()


def test_opengl_shows_as_much() -> None:
    who, cameras = crowd(), rig()
    seen = look(who, WALLED, 1, cameras)
    shown = pixels_in_pictures(who, WALLED, 1, cameras, "opengl")
    np.testing.assert_allclose(seen.pixels * seen.visible, shown, atol=2)


def test_pixels_are_those_of_the_actor_alone() -> None:
    who, cameras = crowd(), rig()
    seen = look(who, WALLED, 1, cameras)
    for k in range(1, len(who)):
        (alone,) = pixels_in_pictures(who[k : k + 1], (), None, cameras)
        assert seen.pixels[k - 1] == pytest.approx(alone, abs=1)  # a ray that only grazes an edge may differ


def test_walls_and_others_hide_and_the_own_body_does_not() -> None:
    who = actors([[0.0, 0.0, 0.0], [16.0, 3.0, 0.0], [8.0, -4.0, 0.0], [20.0, -9.6, 0.0]], model=[0, 0, 0, 1])
    seen = look(who, WALLED, own_id=1)
    assert seen.occluder.tolist() == [STATIC_ID, NOTHING, 3]
    assert seen.visible[1] == 1.0 and (seen.visible[[0, 2]] < 0.6).all()
    without = look(who[1:], WALLED)
    for name in ("pixels", "visible", "occluder"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(without, name))


def test_what_is_nearer_than_near_hides_nothing_and_what_is_farther_than_far_is_not_there() -> None:
    screen = box_part([0.1, 0.0, CAR[2] + 0.15], (0.02, 4.0, 4.0))
    who = actors([[10.0, 0.0, 0.0], [30.0, 8.0, 0.0]])
    front = [replace(rig()[0], far_m=20.0)]
    near, far = (look(who, (*GROUND, screen), cameras=[replace(front[0], near_m=near_m)]) for near_m in (0.05, 0.2))
    assert near.visible.tolist() == [0.0, 0.0] and near.occluder[0] == STATIC_ID
    assert far.visible.tolist() == [1.0, 0.0] and (far.pixels > 0).tolist() == [True, False]
    np.testing.assert_array_equal(near.pixels, far.pixels)


def test_an_empty_world() -> None:
    assert len(look(actors([])).id) == 0 and len(look(actors([[0, 0, 0]]), own_id=1).id) == 0
