"""Sweeps: on the surfaces, as noisy and as lossy as configured, in the agent's own frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from sensor_scenes import CAR, actors, box_part, ground, triangles

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import RayScene
from coopsim.support.rng import stream
from coopsim.types import Sweep
from coopsim.world.snapshot import Actors, StaticPart

EXACT: dict[str, Any] = {"range_noise_m": 0.0, "dropout_energy": 0.0}
MOUNT_M = 1.6
HOME = SE3.identity()
FLOAT32_M = 2e-5
"""Two steps of float32 at 100 m."""


def sense(
    who: Actors | None = None,
    static: Sequence[StaticPart] = (),
    *,
    pose: SE3 = HOME,
    own_id: int | None = None,
    seed: int = 0,
    **config: Any,
) -> Sweep:
    lidar = Lidar(LidarConfig(**({"columns": 512} | config)))
    return lidar.sense(RayScene(triangles(who, static)), pose, MOUNT_M, own_id, stream(seed, "lidar", "cav_0"))


def sensor_m(**config: Any) -> np.ndarray:
    return np.array([0.0, 0.0, MOUNT_M + LidarConfig(**config).above_m])


def ranges(sweep: Sweep) -> np.ndarray:
    return np.linalg.norm(sweep.points - sensor_m(), axis=1)


def of(sweep: Sweep, instance: int) -> np.ndarray:
    assert sweep.instance is not None
    return sweep.points[sweep.instance == instance]


def wall(distance_m: float, *, yaw_rad: float = 0.0, reflectivity: float = 0.5) -> StaticPart:
    """A thin wall ahead, whose near face is `distance_m` away at the middle."""
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    center = [distance_m, 0.0, sensor_m()[2]] + 0.005 * ahead
    return box_part(center, (0.01, 4.0, 4.0), yaw_rad=yaw_rad, reflectivity=reflectivity)


def test_points_lie_on_the_faces_of_the_boxes() -> None:
    who = actors([[12.0, 3.0, 0.4], [-9.0, -6.0, 2.0], [0.0, 25.0, -1.0]], model=[0, 0, 1])
    sweep = sense(who, [ground()], **EXACT)
    for k, actor in enumerate(who.id):
        points = of(sweep, actor)
        assert len(points) > 10
        local = SE3.from_xyz_yaw(who.boxes.center[k], float(who.boxes.yaw[k])).inverse().apply(points)
        outside = np.abs(local) - who.boxes.size[k] / 2
        np.testing.assert_allclose(outside.max(axis=1), 0.0, atol=FLOAT32_M)
    np.testing.assert_allclose(of(sweep, 0)[:, 2], 0.0, atol=FLOAT32_M)


def test_beams_point_where_the_table_says() -> None:
    sweep = sense(static=[ground()], **EXACT)
    arm = sweep.points - sensor_m()
    elevation = np.arctan2(arm[:, 2], np.linalg.norm(arm[:, :2], axis=1))
    np.testing.assert_allclose(elevation, LidarConfig().beams.elevation_rad[sweep.beam], atol=1e-4)


@pytest.mark.parametrize("noise_m", [0.0, 0.5])
def test_ranges_stay_within_the_configured(noise_m: float) -> None:
    sweep = sense(
        actors([[3.0, 0.0, 0.0]]),
        [ground()],
        min_range_m=4.0,
        max_range_m=30.0,
        range_noise_m=noise_m,
        dropout_energy=0,
    )
    assert len(sweep) > 1000
    assert ranges(sweep).min() >= 4.0 - 1e-4 and ranges(sweep).max() <= 30.0 + 1e-4
    assert ranges(sweep).max() > 25.0


def test_noise_is_as_large_as_configured_and_along_the_ray() -> None:
    static = [ground(), wall(20.0)]
    exact = sense(static=static, **EXACT)
    noisy = sense(static=static, range_noise_m=0.05, dropout_energy=0.0)
    assert len(noisy) == len(exact) > 5000
    error = ranges(noisy) - ranges(exact)
    inner = ranges(exact) < 119.0  # at the very end of the range, readings are limited
    assert abs(error[inner].mean()) < 0.003
    assert error[inner].std() == pytest.approx(0.05, rel=0.05)
    rays = (exact.points - sensor_m()) / ranges(exact)[:, None]
    np.testing.assert_allclose(noisy.points, sensor_m() + rays * ranges(noisy)[:, None], atol=1e-3)


def share_returned(distance_m: float, turned_deg: float = 0.0, reflectivity: float = 0.5) -> float:
    """Return the share of returns from a wall, of 64 beams so close together that all meet it nearly alike."""
    close = BeamPattern("close", np.radians(np.linspace(-1.0, 1.0, 64)))
    part = [wall(distance_m, yaw_rad=np.radians(turned_deg), reflectivity=reflectivity)]
    lossless, lossy = (
        sense(
            static=part,
            pattern=close,
            columns=2048,
            range_noise_m=0,
            reference_range_m=25,
            dropout_energy=energy,
            seed=1,
        )
        for energy in (0.0, 0.3)
    )
    assert len(lossless) > 1000
    return len(lossy) / len(lossless)


def test_drop_out_follows_the_documented_law() -> None:
    """More is lost with range, with incidence and on dark surfaces."""
    walls = [(10.0, 0.0, 0.5), (20.0, 0.0, 0.5), (30.0, 0.0, 0.5), (50.0, 0.0, 0.5)]
    walls += [(20.0, 45.0, 0.5), (20.0, 70.0, 0.5), (20.0, 0.0, 0.1)]
    shares = [share_returned(*each) for each in walls]
    energy = [dark * np.cos(np.radians(turned)) * (25.0 / distance_m) ** 2 for distance_m, turned, dark in walls]
    np.testing.assert_allclose(shares, 1 - np.exp(-np.array(energy) / 0.3), atol=0.04)
    assert shares[0] > 0.99 > shares[1] > shares[2] + 0.1 > shares[3] + 0.2  # near to far
    assert shares[1] > shares[4] > shares[5] + 0.1 and shares[6] < 0.5  # head-on to grazing; dark


def test_no_drop_out_loses_not_even_black() -> None:
    assert len(sense(static=[wall(20.0, reflectivity=0.0)], **EXACT)) == len(sense(static=[wall(20.0)], **EXACT)) > 0


def test_intensity_is_reflectivity_times_cosine() -> None:
    for degrees in (0.0, 60.0):
        sweep = sense(static=[wall(30.0, yaw_rad=np.radians(degrees))], **EXACT)
        middle = np.abs(sweep.points[:, 1:] - sensor_m()[1:]).max(axis=1) < 0.5
        np.testing.assert_allclose(sweep.intensity[middle], 0.5 * np.cos(np.radians(degrees)), atol=0.02)


def test_a_retro_reflector_outshines_white_at_any_incidence_and_range() -> None:
    for degrees in (0.0, 45.0):
        assert share_returned(50.0, degrees, reflectivity=1.0) < 0.6
        assert share_returned(50.0, degrees, reflectivity=200.0) == 1.0
        assert (sense(static=[wall(50.0, yaw_rad=np.radians(degrees), reflectivity=200.0)]).intensity == 1.0).all()


def test_instances_name_what_was_hit() -> None:
    who = actors([[10.0, 0.0, 0.0], [0.0, 12.0, 1.0]], first_id=41)
    sweep = sense(who, [ground()], **EXACT)
    assert sweep.instance is not None
    assert set(sweep.instance.tolist()) == {0, 41, 42}
    np.testing.assert_allclose(of(sweep, 41)[:, 0].min(), 8.0, atol=0.01)


def test_a_wall_in_between_hides_a_car_and_one_beside_does_not() -> None:
    who = actors([[30.0, 0.0, 0.0]])
    # The rear is 2 m wide and 28 m away: it spans 4.1 degrees, 5 columns of 0.70, and from -4.0 to -0.7 degrees of
    # elevation, 2 beams of a table with steps of 1.33.
    assert len(of(sense(who, [ground()], **EXACT), 1)) == 5 * 2
    for left_m, seen in ((8.0, 10), (0.0, 0)):
        assert len(of(sense(who, [ground(), box_part([15.0, left_m, 5.0], (0.3, 12.0, 10.0))], **EXACT), 1)) == seen


def test_the_own_body_gives_no_return_but_is_in_the_way() -> None:
    who = actors([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    own = sense(who, [ground()], own_id=1, **EXACT)
    assert len(of(own, 1)) == 0 and len(of(own, 2)) > 20
    assert len(of(sense(who, [ground()], **EXACT), 1)) > 0
    # The roof hides the ground beside the car that a sensor in the air would see.
    free = sense(who[1:], [ground()], **EXACT)
    assert np.abs(of(own, 0)[:, :2]).max(axis=1).min() > np.abs(of(free, 0)[:, :2]).max(axis=1).min()


def test_points_are_in_the_base_frame_of_a_turned_agent() -> None:
    who = actors([[10.0, 17.0, np.pi / 2], [0.0, 5.0, np.pi / 2]])
    sweep = sense(who, [ground()], pose=SE3.from_xyz_yaw([10.0, 5.0, 0.0], np.pi / 2), **EXACT)
    ahead, left = of(sweep, 1), of(sweep, 2)
    assert ahead[:, 0].min() == pytest.approx(12.0 - CAR[0] / 2, abs=0.01)
    assert np.abs(ahead[:, 1]).max() <= CAR[1] / 2 + 0.01
    assert left[:, 1].min() == pytest.approx(10.0 - CAR[1] / 2, abs=0.01)


def test_turning_and_moving_the_whole_world_changes_nothing() -> None:
    move = SE3.from_xyz_yaw([310.0, -120.0, 0.0], 0.0)
    who = actors([[12.0, 3.0, 0.4], [-9.0, -6.0, 2.0]])
    here = sense(who, [ground()], **EXACT)
    there = sense(who.transform(move), [ground(700.0)], pose=move, **EXACT)
    np.testing.assert_array_equal(here.instance, there.instance)
    np.testing.assert_allclose(here.points, there.points, atol=FLOAT32_M)
    turn = SE3.from_xyz_yaw([310.0, -120.0, 0.0], 1.1)
    turned = sense(who.transform(turn), [ground(700.0)], pose=turn, **EXACT)
    for actor in (1, 2):
        # Rays at an edge may fall to either side of it.
        assert abs(len(of(turned, actor)) - len(of(here, actor))) <= 5
        np.testing.assert_allclose(of(turned, actor).mean(axis=0), of(here, actor).mean(axis=0), atol=0.02)
        brightness = [sweep.intensity[sweep.instance == actor].mean() for sweep in (here, turned)]
        assert brightness[0] == pytest.approx(brightness[1], abs=0.005)


def test_same_stream_same_bits() -> None:
    who = actors([[12.0, 3.0, 0.4]])
    first, again, other = (sense(who, [ground()], seed=seed) for seed in (7, 7, 8))
    for name in ("points", "intensity", "beam", "instance"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.points[:100], other.points[:100])


def ray_number(sweep: Sweep) -> np.ndarray:
    column = np.round(np.arctan2(sweep.points[:, 1], sweep.points[:, 0]) / (2 * np.pi / 512)) % 512
    return sweep.beam * 512 + column.astype(int)


def test_what_one_ray_meets_does_not_shift_the_noise_of_others() -> None:
    """A house takes rays that went into the sky, which come first in a sweep, and some that met the ground."""
    alone = sense(None, [ground()], range_noise_m=0.1)
    beside = sense(None, [ground(), box_part([16.0, 0.3, 5.0], (2.0, 12.0, 10.0))], range_noise_m=0.1)
    others = beside.points[:, 0] < 14.0
    rays, row, _ = np.intersect1d(ray_number(alone), ray_number(beside)[others], return_indices=True)
    assert 5000 < len(rays) == others.sum() < len(alone)
    np.testing.assert_allclose(beside.points[others], alone.points[row], atol=1e-4)


def test_every_sweep_takes_as_many_draws() -> None:
    lidar, states = Lidar(LidarConfig(columns=64)), []
    for who in (None, actors([[5.0, 0.0, 0.0]])):
        rng = stream(1, "lidar", "cav_0")
        lidar.sense(RayScene(triangles(who, [ground()])), HOME, MOUNT_M, None, rng)
        states.append(rng.random())
    assert states[0] == states[1]


def test_a_sensor_on_a_mast_sees_the_road_around_it() -> None:
    scene = RayScene(triangles(actors([[12.0, 0.0, 0.0], [40.0, 10.0, 0.5]]), [ground()]))
    sweep = Lidar(LidarConfig(**EXACT)).sense(scene, HOME, 5.0, None, stream(0, "lidar", "rsu_0"))
    assert len(of(sweep, 1)) > 100 and len(of(sweep, 2)) > 20
    assert np.linalg.norm(of(sweep, 0)[:, :2], axis=1).min() < 10.0


def test_a_custom_table() -> None:
    level = BeamPattern("level", np.zeros(1))
    sweep = sense(static=[wall(10.0)], pattern=level, columns=3600, **EXACT)
    np.testing.assert_allclose(sweep.points[:, 0], 10.0, atol=1e-3)
    assert (sweep.beam == 0).all()


def test_nothing_around_is_an_empty_sweep() -> None:
    assert len(sense()) == 0


@pytest.mark.parametrize(
    ("bad", "error", "match"),
    [
        ({"pattern": "HDL-32"}, UnknownNameError, "Did you mean 'HDL-32E'"),
        ({"pattern": ["HDL-32E"]}, InvalidValueError, "pattern must be a beam table"),
        ({"columns": 0}, InvalidValueError, "columns"),
        ({"columns": True}, InvalidValueError, "columns"),
        ({"columns": 20000}, InvalidValueError, "1..16384"),
        ({"range_noise_m": -0.1}, InvalidValueError, "range_noise_m"),
        ({"dropout_energy": np.nan}, InvalidValueError, "dropout_energy"),
        ({"above_m": np.inf}, InvalidValueError, "above_m"),
        ({"max_range_m": "far"}, InvalidValueError, "max_range_m"),
        ({"max_range_m": 0.5}, InvalidValueError, "min_range_m = 1.0"),
        ({"max_range_m": 1e300}, InvalidValueError, r"max_range_m must be in \[0, 10000\], got 1e\+300"),
        ({"reference_range_m": 0.0}, InvalidValueError, "reference_range_m"),
        ({"reference_range_m": 1e300}, InvalidValueError, "reference_range_m"),
        (
            {"pattern": BeamPattern("slip", np.linspace(-0.5, 0.5, 20_000))},
            InvalidValueError,
            "columns times beams must be at most 8388608, got 20480000",
        ),
    ],
)
def test_bad_numbers_are_refused(bad: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        LidarConfig(**bad)
