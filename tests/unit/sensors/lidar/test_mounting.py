"""Sensors anywhere on an agent: they see the same surfaces, each from its own place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sensor_scenes import actors, box_model, box_part, ground, triangles

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig, require_free_mount
from coopsim.sensors.scene import RayScene
from coopsim.support.rng import stream
from coopsim.types import Sweep
from coopsim.world.models import make_models

HEIGHT_M = 1.6
EXACT: dict[str, Any] = {"range_noise_m": 0.0, "dropout_energy": 0.0, "columns": 512}
ASKEW: dict[str, Any] = {"x_m": 1.5, "y_m": -0.7, "above_m": -0.4, "roll_rad": 0.1, "pitch_rad": 0.2, "yaw_rad": -2.0}


def sense(pose: SE3 | None = None, **config: Any) -> Sweep:
    scene = RayScene(
        triangles(actors([[14.0, 3.0, 0.4], [-9.0, -6.0, 2.0]]), [ground(), box_part([5, 20, 4], (30, 1, 8))])
    )
    lidar = Lidar(LidarConfig(**(EXACT | config)))
    return lidar.sense(scene, pose or SE3.identity(), HEIGHT_M, None, stream(0, "lidar", "cav_0"))


def test_points_are_in_the_agents_frame_wherever_the_sensor_is() -> None:
    sweep = sense(**ASKEW)
    assert sweep.instance is not None and set(sweep.instance.tolist()) == {0, 1, 2}
    scenery = sweep.points[sweep.instance == 0]
    on_wall = np.abs(scenery[:, 1] - 19.5) < 1e-4
    assert on_wall.sum() > 100 and (~on_wall).sum() > 1000
    np.testing.assert_allclose(scenery[~on_wall, 2], 0.0, atol=1e-4)
    place = SE3.from_xyz_yaw([14.0, 3.0, 0.8], 0.4).inverse().apply(sweep.points[sweep.instance == 1])
    np.testing.assert_allclose((np.abs(place) - [2.0, 1.0, 0.8]).max(axis=1), 0.0, atol=1e-4)


def test_both_backends_agree_at_any_mounting() -> None:
    pose = SE3.from_xyz_yaw([2.0, 1.0, 0.0], 0.7)
    grid, embree = (sense(pose, backend=backend, **ASKEW) for backend in ("grid", "embree"))
    assert len(grid) == len(embree) > 1000  # in this scene; elsewhere one ray in a thousand may differ
    np.testing.assert_array_equal(grid.beam, embree.beam)
    np.testing.assert_allclose(grid.points, embree.points, atol=1e-3)
    np.testing.assert_allclose(grid.intensity, embree.intensity, atol=1e-3)


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        ({}, (1, 0, 0)),
        ({"yaw_rad": np.pi / 2}, (0, 1, 0)),  # to the left
        ({"pitch_rad": np.pi / 6}, (np.cos(np.pi / 6), 0, -0.5)),  # down
        ({"roll_rad": np.pi / 2}, (1, 0, 0)),
        ({"yaw_rad": np.pi / 2, "pitch_rad": np.pi / 6}, (0, np.cos(np.pi / 6), -0.5)),
    ],
)
def test_where_a_turned_sensor_looks(turn: dict[str, float], expected: tuple[float, float, float]) -> None:
    rotation = LidarConfig(**turn).base_SE3_sensor(HEIGHT_M).rotation
    np.testing.assert_allclose(rotation @ [1.0, 0.0, 0.0], expected, atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_rolling_to_the_right_lowers_the_right_side() -> None:
    right = LidarConfig(roll_rad=0.1).base_SE3_sensor(HEIGHT_M).rotation @ [0.0, -1.0, 0.0]
    assert right[2] < 0


CAR = box_model((4.0, 2.0, HEIGHT_M))


@pytest.mark.parametrize(
    ("mount", "match"),
    [
        ({"above_m": -1.9}, "lidar 'front' is 0.3 m under the ground: above_m = -1.9"),
        ({"above_m": -1.6}, "under the ground"),
        ({"above_m": -0.3}, "lidar 'front' at x, y, z = 0, 0, 1.3 m is inside the body of a 'box'"),
        ({"above_m": -0.3, "x_m": 1.99}, "inside the body"),
    ],
)
def test_a_sensor_that_could_see_nothing_is_refused(mount: dict[str, float], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        require_free_mount("front", LidarConfig(**mount), HEIGHT_M, CAR)


@pytest.mark.parametrize(
    "mount", [{}, {"above_m": -1.0, "x_m": 2.05}, {"above_m": 0.01}, {"y_m": 1.01, "above_m": -0.5}]
)
def test_a_sensor_outside_the_body_is_free(mount: dict[str, float]) -> None:
    require_free_mount("front", LidarConfig(**mount), HEIGHT_M, CAR)


def test_the_space_over_a_bonnet_is_not_inside_the_car() -> None:
    sedan = make_models()[0]
    height_m = float(sedan.size_m[2])
    require_free_mount("bonnet", LidarConfig(x_m=2.0, above_m=-0.2), height_m, sedan)
    with pytest.raises(InvalidValueError, match="inside the body of a 'sedan'"):
        require_free_mount("engine", LidarConfig(x_m=2.0, above_m=-0.9), height_m, sedan)


def test_a_mast_has_no_inside() -> None:
    require_free_mount("mast", LidarConfig(above_m=-1.0), 5.0, None)


@pytest.mark.parametrize(
    ("bad", "error", "match"),
    [
        ({"x_m": np.nan}, InvalidValueError, r"x_m must be in \[-100, 100\], got nan"),
        ({"above_m": 2900.0}, InvalidValueError, r"above_m must be in \[-100, 100\], got 2900.0"),
        ({"pitch_rad": "down"}, InvalidValueError, "pitch_rad must be a finite number"),
        ({"backend": "gpu"}, UnknownNameError, "unknown backend 'gpu'.*embree, grid"),
        ({"backend": "torch"}, UnknownNameError, "unknown backend 'torch'.*embree, grid"),
    ],
)
def test_bad_mounts_are_refused(bad: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        LidarConfig(**bad)
