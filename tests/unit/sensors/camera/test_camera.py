"""Pictures: pinhole geometry, depth along the optical axis, and cameras that sit where they should; however drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sensor_scenes import CAR, POST, Studio, actors, box_part, ground

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera, named_rig
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.types import CameraImage
from coopsim.world.snapshot import Actors, AgentBody

HOME = SE3.identity()
MAST_M = 5.0
SKY = (168, 195, 222)

Shoot = Callable[..., dict[str, CameraImage]]


def car(pose: SE3 = HOME) -> AgentBody:
    return AgentBody("cav_0", "cav", None, pose, CAR[2])


@pytest.fixture(params=["raycast", "opengl", "pyrender"])
def shoot(request: pytest.FixtureRequest) -> Iterator[Shoot]:
    """Takes an agent's four pictures of a scene; keywords change its cameras."""
    studios = []

    def take(who: Actors | None = None, static: Any = (), body: AgentBody | None = None, **config: Any) -> Any:
        body = body or car()
        rig = [replace(camera, **config) for camera in named_rig("surround")]
        studios.append(Studio(request.param, static, cameras={body.name: rig}))
        return studios[-1].shoot(actors([]) if who is None else who, {body.name: body})[body.name]

    yield take
    for studio in studios:
        studio.rig.close()


def test_a_box_projects_where_a_pinhole_puts_it(shoot: Shoot) -> None:
    who = actors([[12.0, 3.0, 0.3]])
    seen = shoot(who)["front"].depth > 0
    forward, left, up = (who.boxes.corners[0] - [0.0, 0.0, CAR[2] + Camera("x").above_m]).T
    focal_px = 160 / np.tan(np.radians(50))
    column, row = 160 - focal_px * left / forward, 90 - focal_px * up / forward
    for axis, edge in ((0, column), (1, row)):
        pixels = np.flatnonzero(seen.any(axis=axis))
        assert pixels[0] == pytest.approx(edge.min(), abs=1.5) and pixels[-1] + 1 == pytest.approx(edge.max(), abs=1.5)


def test_any_intrinsics_project_points_where_the_picture_shows_them(shoot: Shoot) -> None:
    """Oblong pixels, an axis beside the middle, a lens that distorts: posts stand where `project` says."""
    lens = Intrinsics(201, 160, 120.0, 150.0, 90.0, 70.0, (-0.2, 0.05, 0.002, -0.001, 0.0))
    camera = Camera("front", lens)
    for place in ([8.0, 4.0], [8.0, -5.0], [20.0, 1.0]):
        who = actors([[*place, 0.0]], model=1)
        rows, columns = np.nonzero(shoot(who, intrinsics=lens)["front"].depth)
        near = who.boxes.corners[0]
        seen = lens.project(camera.base_SE3_camera(CAR[2]).inverse().apply(near))
        assert columns.min() == pytest.approx(seen[:, 0].min(), abs=1.5)
        assert columns.max() == pytest.approx(seen[:, 0].max(), abs=1.5)
        assert rows.max() == pytest.approx(seen[:, 1].max(), abs=1.5)


@pytest.mark.parametrize("k1", [0.0, -0.2])
def test_depth_is_along_the_optical_axis(shoot: Shoot, k1: float) -> None:
    """A wall across the view is equally deep in every pixel, though its corners are farther away."""
    lens = Intrinsics.from_fov(distortion=(k1, 0.05, 0.0, 0.0, 0.0))
    images = shoot(static=[box_part([10.5, 0.0, 0.0], (1.0, 90.0, 60.0))], intrinsics=lens)
    np.testing.assert_allclose(images["front"].depth, 10.0, atol=1e-3)
    assert (images["rear"].depth == 0).all() and (images["rear"].rgb == SKY).all()


def test_four_cameras_look_ahead_left_back_and_right(shoot: Shoot) -> None:
    pose = SE3.from_xyz_yaw([40.0, -7.0, 0.0], 0.8)
    distance_m = {"front": 10.0, "left": 12.0, "rear": 14.0, "right": 16.0}
    places = pose.apply([[10.0, 0, 0], [0, 12.0, 0], [-14.0, 0, 0], [0, -16.0, 0]])
    places[:, 2] = pose.yaw
    images = shoot(actors(places, model=1), body=car(pose))
    assert images.keys() == distance_m.keys()
    for name, image in images.items():
        rows, columns = np.nonzero(image.depth)
        assert columns.mean() + 0.5 == pytest.approx(160, abs=1)
        np.testing.assert_allclose(image.depth[rows, columns], distance_m[name] - POST[0] / 2, atol=0.01)


@pytest.mark.parametrize(
    ("above_m", "pitch_rad", "plane_m"), [(0.15, 0.35, 0.0), (-0.5, 0.35, 0.0), (0.15, -0.5, 30.0)]
)
def test_a_pitched_camera_looks_down_or_up(shoot: Shoot, above_m: float, pitch_rad: float, plane_m: float) -> None:
    """Down to the ground, or up to a ceiling: the plane's depth in the middle tells height and pitch."""
    mast = AgentBody("rsu_0", "rsu", None, SE3.from_xyz_yaw([3.0, 2.0, 0.0], 0.5), MAST_M)
    floor_and_ceiling = [ground(), box_part([0.0, 0.0, 30.5], (300.0, 300.0, 1.0))]
    lens = Intrinsics.from_fov(321, 181)
    images = shoot(static=floor_and_ceiling, body=mast, intrinsics=lens, above_m=above_m, pitch_rad=pitch_rad)
    assert images
    for image in images.values():
        expected_m = (MAST_M + above_m - plane_m) / np.sin(pitch_rad)
        assert image.depth[90, 160] == pytest.approx(expected_m, rel=1e-3)


def test_a_rolled_camera_turns_its_picture_the_other_way(shoot: Shoot) -> None:
    """Clockwise by a quarter: what is on the ground below is seen on the right."""
    images = shoot(static=[ground()], roll_rad=np.pi / 2)
    seen = images["front"].depth[30:150] > 0  # further out, the ground ends before the horizon
    assert seen[:, 170:].all() and not seen[:, :160].any()


def test_a_camera_is_where_it_is_mounted(shoot: Shoot) -> None:
    """Two metres ahead a wall is two metres nearer; to the left, a post is farther right."""
    who = actors([[10.0, 0.0, 0.0]], model=1)
    depth = shoot(who, x_m=2.0, y_m=1.0)["front"].depth
    nearest_m = depth[depth > 0].min()
    assert nearest_m == pytest.approx(8.0 - POST[0] / 2, abs=0.01)
    columns = np.nonzero(np.abs(depth - nearest_m) < 0.01)[1]  # its front
    focal_px = Intrinsics.from_fov().fx_px
    assert columns.mean() + 0.5 == pytest.approx(160 + focal_px * 1.0 / 7.7, abs=1.0)


def test_only_what_is_near_enough_is_drawn(shoot: Shoot) -> None:
    walls = [box_part([10.5, 0.0, 0.0], (1.0, 60.0, 60.0)), box_part([-40.5, 0.0, 0.0], (1.0, 60.0, 60.0))]
    images = shoot(static=walls, far_m=20.0, intrinsics=Intrinsics.from_fov(64, 48))
    assert (images["front"].depth > 0).all() and (images["rear"].depth == 0).all()


def test_what_is_nearer_than_near_is_looked_through(shoot: Shoot) -> None:
    height_m = CAR[2] + Camera("x").above_m
    screen = box_part([0.1, 0.0, height_m], (0.02, 4.0, 4.0))
    wall = box_part([10.5, 0.0, 0.0], (1.0, 60.0, 60.0))
    lens = Intrinsics.from_fov(64, 48)
    for near_m, depth_m in ((0.05, 0.09), (0.2, 10.0)):
        image = shoot(static=[screen, wall], intrinsics=lens, near_m=near_m)["front"]
        np.testing.assert_allclose(image.depth, depth_m, atol=1e-3)


def test_paint_shows_and_the_roof_is_lighter_than_the_side_in_the_shade(shoot: Shoot) -> None:
    mast = AgentBody("rsu_0", "rsu", None, HOME, MAST_M)
    image = shoot(actors([[10.0, 0.0, 0.0]], color=(250, 10, 10)), body=mast)["front"]
    red = image.rgb[..., 0] > 2 * image.rgb[..., 2].astype(int)
    assert (red == (image.depth > 0)).all()
    columns = image.rgb[:, 160, 0][red[:, 160]]  # roof above, the side that faces us below
    assert columns[1] > columns[-2] + 30


def test_pictures_are_as_large_as_said(shoot: Shoot) -> None:
    images = shoot(static=[ground()], intrinsics=Intrinsics.from_fov(48, 31))
    assert images
    for image in images.values():
        assert image.rgb.shape == (31, 48, 3) and image.depth.shape == (31, 48)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"name": "front left"}, "name of a camera must be a word"),
        ({"name": 3}, "name of a camera must be a word"),
        ({"intrinsics": (320, 180)}, "intrinsics of camera 'a' must be Intrinsics"),
        ({"near_m": 0.0}, r"near_m of camera 'a' must be in \[0.001, 10000\], got 0.0"),
        ({"near_m": 2.0, "far_m": 1.0}, "near_m must be less than far_m of camera 'a', got 2.0 and 1.0"),
        ({"far_m": np.inf}, "far_m of camera 'a'"),
        ({"far_m": 1e39}, "far_m of camera 'a'"),
        ({"above_m": np.nan}, r"above_m of camera 'a' must be in \[-100, 100\], got nan"),
        ({"x_m": 1500.0}, r"x_m of camera 'a' must be in \[-100, 100\]"),
        ({"x_m": "1"}, "x_m of camera 'a'"),
        ({"pitch_rad": np.inf}, "pitch_rad of camera 'a'"),
        ({"yaw_rad": None}, "yaw_rad of camera 'a'"),
    ],
)
def test_bad_mounts_are_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        Camera(**({"name": "a"} | bad))
