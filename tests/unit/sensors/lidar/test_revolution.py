"""A revolution takes time: moving things are where they were when the beam passed, standing ones stay straight."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sensor_scenes import MODELS, actors, box_part, ground, soup

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.lidar.ray_grid import SECTORS, earlier, interpolate
from coopsim.sensors.scene import RayScene, SceneGeometry
from coopsim.support.rng import stream
from coopsim.types import Sweep
from coopsim.world.snapshot import Actors, StaticPart

TURN_S = 0.1
FLAT = BeamPattern("flat", np.radians([-2.0, -6.0]))


def sense(
    who: Actors, static: list[StaticPart], end: SE3, start: SE3 | None, *, turn_s: float = TURN_S, **config: Any
) -> Sweep:
    exact = {"pattern": FLAT, "columns": 1024, "range_noise_m": 0.0, "dropout_energy": 0.0}
    lidar = Lidar(LidarConfig(turn_s=turn_s, **(exact | config)))
    scene = RayScene(SceneGeometry(MODELS, static).triangles(who))
    return lidar.sense(scene, end, 1.65, None, stream(0, "lidar"), start)


def moving(rows: list[list[float]], velocity: list[list[float]]) -> Actors:
    return replace(actors(rows), velocity=np.array(velocity))


def test_without_motion_the_duration_changes_nothing() -> None:
    who, static = actors([[15.0, 4.0, 0.3], [-9.0, 9.0, 1.0]]), [ground(), box_part([-20, 5, 3], (2, 30, 6))]
    pose = SE3.from_xyz_yaw([1.0, 2.0, 0.0], 0.5)
    at_once, in_turn = sense(who, static, pose, None, turn_s=0.0), sense(who, static, pose, pose)
    np.testing.assert_allclose(in_turn.points, at_once.points, atol=1e-4)
    np.testing.assert_array_equal(in_turn.instance, at_once.instance)


def test_walls_stay_straight_for_an_agent_that_drives_and_turns() -> None:
    """Points are in the base frame at the end: standing things are where they are, whenever they were sensed."""
    start, end = SE3.from_xyz_yaw([0.0, 0.0, 0.0], 0.0), SE3.from_xyz_yaw([2.0, 0.5, 0.0], 0.2)
    sweep = sense(actors([]), [box_part([30, 0, 5], (1, 200, 10)), box_part([-30, 0, 5], (1, 200, 10))], end, start)
    world = end.apply(sweep.points)
    np.testing.assert_allclose(np.abs(world[:, 0]), 29.5, atol=1e-3)
    assert len(world) > 500


def test_a_car_is_where_it_was_when_the_beam_passed() -> None:
    """A beam passes the right side (-y) after three quarters of a revolution, the left one after one quarter."""
    for left_m, passed in ((10.0, 0.25), (-10.0, 0.75)):
        who = moving([[0.0, left_m, 0.0]], [[20.0, 0.0]])
        sweep = sense(who, [], SE3.identity(), None)
        near = sweep.points[np.abs(np.abs(sweep.points[:, 1]) - 9.0) < 0.01]
        middle = (near[:, 0].min() + near[:, 0].max()) / 2
        assert middle == pytest.approx(-20.0 * TURN_S * (1 - passed), abs=0.2)


def test_a_car_that_keeps_pace_stands_still() -> None:
    who = moving([[0.0, 10.0, 0.0]], [[20.0, 0.0]])
    start = SE3.from_xyz_yaw([-20.0 * TURN_S, 0.0, 0.0], 0.0)
    paced = sense(who, [], SE3.identity(), start)
    still = sense(actors([[0.0, 10.0, 0.0]]), [], SE3.identity(), None)
    # Rays hit it alike; its points are moved to the end of the revolution with the sensor, not with the car.
    assert len(paced) == len(still)
    late = np.linspace(0, 1, SECTORS + 1)
    shift = paced.points[:, 0] - still.points[:, 0]
    assert ((shift > -20.0 * TURN_S * late[-1]) & (shift < 0)).all()
    np.testing.assert_allclose(paced.points[:, 1:], still.points[:, 1:], atol=1e-4)


def test_poses_interpolate() -> None:
    start, end = SE3.from_xyz_yaw([0.0, 0.0, 0.0], 3.0), SE3.from_xyz_yaw([2.0, 4.0, 0.0], -3.0)
    half = interpolate(start, end, 0.5)
    np.testing.assert_allclose(half.translation, [1.0, 2.0, 0.0])
    assert abs(half.yaw) == pytest.approx(np.pi)  # the short way round
    np.testing.assert_allclose(interpolate(start, end, 1.0).rotation, end.rotation, atol=1e-12)
    np.testing.assert_allclose(interpolate(start, end, -1.0).translation, [-2.0, -4.0, 0.0])


def test_a_scene_without_velocities_has_no_earlier_time() -> None:
    with pytest.raises(InvalidValueError, match="no earlier time"):
        earlier(soup(np.zeros((1, 3, 3))), 0.1)


@pytest.mark.parametrize("columns", [1, 20, 1000])
def test_any_number_of_columns(columns: int) -> None:
    sweep = sense(actors([]), [ground()], SE3.identity(), SE3.from_xyz_yaw([-1, 0, 0], 0.0), columns=columns)
    assert len(sweep) == 2 * columns


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"turn_s": -0.1}, r"turn_s must be in \[0, 1\]"),
        ({"turn_s": 0.1, "backend": "embree"}, "turn_s must be 0 with the backend embree"),
    ],
)
def test_bad_durations_are_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        LidarConfig(**bad)
