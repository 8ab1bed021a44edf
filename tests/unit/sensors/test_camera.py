"""Pictures: pinhole geometry, depth along the optical axis, and cameras that sit where they should; however drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from sensor_scenes import CAR, POST, actors, box_part, ground, make_rig

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera import CAMERAS, CameraConfig, CameraRig
from coopsim.sensors.renderers import SKY
from coopsim.types import CameraImage
from coopsim.world.snapshot import Actors, AgentBody

HOME = SE3.identity()
MAST_M = 5.0

Shoot = Callable[..., dict[str, CameraImage]]


def car(pose: SE3 = HOME) -> AgentBody:
    return AgentBody("cav_0", "cav", None, pose, CAR[2])


@pytest.fixture(params=["raycast", "opengl"])
def shoot(request: pytest.FixtureRequest) -> Iterator[Shoot]:
    """Takes an agent's four pictures of a scene."""
    rigs = []

    def take(who: Actors | None = None, static: Any = (), body: AgentBody | None = None, **config: Any) -> Any:
        rigs.append(make_rig(request.param, static, config=CameraConfig(**config)))
        body = body or car()
        return rigs[-1].render(actors([]) if who is None else who, {body.name: body})[body.name]

    yield take
    for rig in rigs:
        rig.close()


def test_a_box_projects_where_a_pinhole_puts_it(shoot: Shoot) -> None:
    who, config = actors([[12.0, 3.0, 0.3]]), CameraConfig()
    seen = shoot(who)["front"].depth > 0
    forward, left, up = (who.boxes.corners[0] - [0.0, 0.0, CAR[2] + config.above_m]).T
    focal_px = 160 / np.tan(np.radians(50))
    column, row = 160 - focal_px * left / forward, 90 - focal_px * up / forward
    for axis, edge in ((0, column), (1, row)):
        pixels = np.flatnonzero(seen.any(axis=axis))
        assert pixels[0] == pytest.approx(edge.min(), abs=1.5) and pixels[-1] + 1 == pytest.approx(edge.max(), abs=1.5)


def test_depth_is_along_the_optical_axis(shoot: Shoot) -> None:
    """A wall across the view is equally deep in every pixel, though its corners are farther away."""
    images = shoot(static=[box_part([10.5, 0.0, 0.0], (1.0, 60.0, 60.0))])
    np.testing.assert_allclose(images["front"].depth, 10.0, atol=1e-3)
    assert (images["rear"].depth == 0).all() and (images["rear"].rgb == SKY).all()


def test_four_cameras_look_ahead_left_back_and_right(shoot: Shoot) -> None:
    pose = SE3.from_xyz_yaw([40.0, -7.0, 0.0], 0.8)
    distance_m = {"front": 10.0, "left": 12.0, "rear": 14.0, "right": 16.0}
    places = pose.apply([[10.0, 0, 0], [0, 12.0, 0], [-14.0, 0, 0], [0, -16.0, 0]])
    places[:, 2] = pose.yaw
    images = shoot(actors(places, model=1), body=car(pose))
    assert images.keys() == CAMERAS.keys() == distance_m.keys()
    for name, image in images.items():
        rows, columns = np.nonzero(image.depth)
        assert columns.mean() + 0.5 == pytest.approx(160, abs=1)
        np.testing.assert_allclose(image.depth[rows, columns], distance_m[name] - POST[0] / 2, atol=0.01)


@pytest.mark.parametrize(
    ("above_m", "pitch_rad", "plane_m"), [(0.15, 0.35, 0.0), (-0.5, 0.35, 0.0), (0.15, -0.5, 30.0)]
)
def test_cameras_of_a_roadside_unit_are_pitched(shoot: Shoot, above_m: float, pitch_rad: float, plane_m: float) -> None:
    """Down to the ground, or up to a ceiling: the plane's depth in the middle tells height and pitch."""
    mast = AgentBody("rsu_0", "rsu", None, SE3.from_xyz_yaw([3.0, 2.0, 0.0], 0.5), MAST_M)
    floor_and_ceiling = [ground(), box_part([0.0, 0.0, 30.5], (300.0, 300.0, 1.0))]
    images = shoot(
        static=floor_and_ceiling, body=mast, width=321, height=181, above_m=above_m, unit_pitch_rad=pitch_rad
    )
    for image in images.values():
        expected_m = (MAST_M + above_m - plane_m) / np.sin(pitch_rad)
        assert image.depth[90, 160] == pytest.approx(expected_m, rel=1e-3)


def test_only_what_is_near_enough_is_drawn(shoot: Shoot) -> None:
    walls = [box_part([10.5, 0.0, 0.0], (1.0, 60.0, 60.0)), box_part([-40.5, 0.0, 0.0], (1.0, 60.0, 60.0))]
    images = shoot(static=walls, far_m=20.0, width=64, height=48)
    assert (images["front"].depth > 0).all() and (images["rear"].depth == 0).all()


def test_paint_shows_and_the_roof_is_lighter_than_the_side_in_the_shade(shoot: Shoot) -> None:
    mast = AgentBody("rsu_0", "rsu", None, HOME, MAST_M)
    image = shoot(actors([[10.0, 0.0, 0.0]], color=(250, 10, 10)), body=mast)["front"]
    red = image.rgb[..., 0] > 2 * image.rgb[..., 2].astype(int)
    assert (red != (image.depth > 0)).mean() < 0.005  # OpenGL smooths edges
    columns = image.rgb[:, 160, 0][red[:, 160]]  # roof above, the side that faces us below
    assert columns[1] > columns[-2] + 30


def test_pictures_are_as_large_as_said(shoot: Shoot) -> None:
    images = shoot(static=[ground()], width=48, height=31)
    for name, size in CameraRig.sizes(CameraConfig(width=48, height=31)).items():
        assert images[name].rgb.shape == (*size, 3) and images[name].depth.shape == size == (31, 48)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"width": 0}, "width must be an integer >= 1"),
        ({"height": 10.5}, "height must be an integer >= 1"),
        ({"horizontal_fov_rad": np.pi}, r"in \(0, pi\)"),
        ({"horizontal_fov_rad": 0.0}, "horizontal_fov_rad"),
        ({"near_m": 0.0}, "near_m"),
        ({"near_m": 2.0, "far_m": 1.0}, "near_m < far_m"),
        ({"far_m": np.inf}, "far_m"),
        ({"above_m": np.nan}, "above_m and unit_pitch_rad must be finite"),
        ({"unit_pitch_rad": np.inf}, "above_m and unit_pitch_rad must be finite"),
    ],
)
def test_bad_numbers_are_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        CameraConfig(**bad)
