"""Imperfections of real LiDARs, against hand-made scenes whose geometry is known."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sensor_scenes import CAR, MODELS, actors, box_part, ground

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.imperfections import Imperfections
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.sensors.scene import RayScene, SceneGeometry
from coopsim.support.rng import stream
from coopsim.types import Sweep
from coopsim.world.models.surfaces import GLASS_REFLECTIVITY
from coopsim.world.snapshot import Actors, StaticPart

FLAT = BeamPattern("flat", np.radians([-4.0, -6.0]))
HEIGHT_M = 1.65
SENSOR_M = HEIGHT_M + LidarConfig().above_m


def sense(flaws: Imperfections | None, static: list[StaticPart], who: Actors | None = None, **config: Any) -> Sweep:
    exact: dict[str, Any] = {"pattern": FLAT, "columns": 2048, "range_noise_m": 0.0, "dropout_energy": 0.0}
    lidar = Lidar(LidarConfig(imperfections=flaws, **(exact | config)))
    scene = RayScene(SceneGeometry(MODELS, static).triangles(actors([]) if who is None else who))
    return lidar.sense(scene, SE3.identity(), HEIGHT_M, None, stream(0, "lidar"))


def test_no_imperfections_leave_every_point_in_place() -> None:
    static, who = [ground(), box_part([0, 20, 3], (60, 2, 6))], actors([[15.0, 4.0, 0.3]])
    ideal, same = sense(None, static, who), sense(Imperfections(), static, who)
    np.testing.assert_array_equal(same.points, ideal.points)
    np.testing.assert_array_equal(same.intensity, ideal.intensity)
    np.testing.assert_array_equal(same.instance, ideal.instance)


def test_a_seed_gives_the_same_bits_and_another_unit_does_not() -> None:
    flaws = Imperfections(speckle=0.4, lost_share=0.1, edge_rad=0.003, through=0.5, beam_rad=0.001, unit=3)
    first, again = sense(flaws, [ground()]), sense(flaws, [ground()])
    assert first.points.tobytes() == again.points.tobytes() and first.intensity.tobytes() == again.intensity.tobytes()
    other = sense(replace(flaws, unit=4), [ground()])
    assert other.points.tobytes() != first.points.tobytes()


def test_losses_take_their_share_whatever_the_surface() -> None:
    static = [ground(), box_part([0, 20, 3], (60, 2, 6), reflectivity=0.05)]
    left = len(sense(Imperfections(lost_share=0.2), static).points) / len(sense(None, static).points)
    assert left == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("falloff", [0.7, 1.0, 1.8])
def test_drop_out_rises_with_range_and_with_incidence(falloff: float) -> None:
    """Beams at falling elevations meet the ground ever farther away, at ever more grazing incidence."""
    beams = BeamPattern("rows", np.radians([-20.0, -8.0, -4.0, -2.0, -1.2]))
    sweep = sense(Imperfections(falloff=falloff), [ground()], pattern=beams, dropout_energy=0.02, max_range_m=500.0)
    shares = np.bincount(sweep.beam, minlength=5) / 2048
    assert (np.diff(shares) <= 0).all() and shares[0] > 0.95 and shares[-1] < 0.5


def test_a_steeper_fall_off_dims_grazing_surfaces_more() -> None:
    wall = [box_part([10, 0, 5], (1, 200, 10))]
    beam = BeamPattern("level", np.radians([0.0]))

    def brightness(falloff: float) -> tuple[float, float]:
        sweep = sense(Imperfections(falloff=falloff), wall, pattern=beam)
        aside = np.abs(sweep.points[:, 1])
        return float(sweep.intensity[aside < 1].mean()), float(sweep.intensity[aside > 30].mean())

    assert brightness(0.0)[1] == pytest.approx(brightness(0.0)[0], rel=0.02)
    assert brightness(2.0)[1] < 0.5 * brightness(1.0)[1]


def test_edge_points_lie_between_the_two_surfaces_and_on_the_edge() -> None:
    """A panel 0.5 m before a wall: echoes merge, so some ranges are strictly between."""
    static = [box_part([10.0, 0, 5], (0.2, 4, 10)), box_part([10.5, 0, 5], (0.2, 100, 10))]
    beams = BeamPattern("near level", np.radians(np.linspace(-4, 4, 41)))
    crisp, soft = sense(None, static, pattern=beams), sense(Imperfections(edge_rad=0.006), static, pattern=beams)

    def between(sweep: Sweep) -> np.ndarray:
        ahead = np.abs(sweep.points[:, 1]) < 5
        x = sweep.points[ahead, 0]
        found: np.ndarray = sweep.points[ahead][(x > 9.95) & (x < 10.35)]
        return found

    assert len(between(crisp)) == 0 and len(between(soft)) >= 10
    assert (np.abs(np.abs(between(soft)[:, 1]) - 2.0) < 0.12).all()


def test_surfaces_far_behind_each_other_do_not_mix() -> None:
    static = [box_part([10.0, 0, 5], (0.2, 4, 10)), box_part([20.0, 0, 5], (0.2, 100, 10))]
    beam = BeamPattern("level", np.radians([0.0]))
    soft = sense(Imperfections(edge_rad=0.006), static, pattern=beam)
    ahead = soft.points[np.abs(soft.points[:, 1]) < 2.3]
    assert ((np.abs(ahead[:, 0] - 9.9) < 0.02) | (np.abs(ahead[:, 0] - 19.9) < 0.02)).all()


def test_an_unknown_tilt_tilts_the_ground() -> None:
    """A sensor that really looks down by an angle reports ground ahead as rising by it."""
    tilted = sense(Imperfections(pitch_rad=0.02), [ground()])
    slope = np.polyfit(tilted.points[:, 0], tilted.points[:, 2], 1)[0]
    assert slope == pytest.approx(np.tan(0.02), rel=0.02)
    rolled = sense(Imperfections(roll_rad=0.02), [ground()])
    assert np.polyfit(rolled.points[:, 1], rolled.points[:, 2], 1)[0] == pytest.approx(-np.tan(0.02), rel=0.02)


def test_a_mount_higher_than_told_lowers_the_ground() -> None:
    assert sense(Imperfections(up_m=0.1), [ground()]).points[:, 2] == pytest.approx(-0.1, abs=1e-3)


def test_errors_of_beams_bend_the_ground_row_by_row() -> None:
    sweep = sense(Imperfections(beam_rad=0.002, unit=1), [ground()])
    for beam in range(2):
        row = sweep.points[sweep.beam == beam]
        assert row[:, 2].std() < 1e-3 and 1e-4 < abs(row[:, 2].mean()) < 0.5


def test_windows_let_rays_in_and_paint_does_not() -> None:
    shell = MODELS[0]
    glass = replace(shell, reflectivity=np.full(len(shell.faces), GLASS_REFLECTIVITY), tint=np.zeros(len(shell.faces)))
    for model, looks_in in ((shell, False), (glass, True)):
        scene = RayScene(SceneGeometry([model], []).triangles(actors([[10.0, 0.0, 0.0]])))
        config = LidarConfig(FLAT, columns=2048, range_noise_m=0.0, dropout_energy=0.0)
        points = [
            Lidar(replace(config, imperfections=flaws))
            .sense(scene, SE3.identity(), HEIGHT_M, None, stream(0, "l"))
            .points
            for flaws in (None, Imperfections(through=0.8))
        ]
        behind = points[1][:, 0] - (10 - CAR[0] / 2)
        if not looks_in:
            np.testing.assert_array_equal(points[0], points[1])
            continue
        assert len(points[1]) / len(points[0]) == pytest.approx(0.6, abs=0.1)
        assert (behind > 0.15).mean() == pytest.approx(0.4 / 0.6, abs=0.12) and behind.max() < 1.7


def test_a_moving_car_is_where_it_was_when_the_beam_passed() -> None:
    """The left of the agent is passed after a quarter of the revolution, and 0.025 s are left of it then."""
    still = actors([[0.0, 10.0, 0.0]])
    moving = replace(still, velocity=np.array([[20.0, 0.0]]))
    for stamp, age_s in ((1.0, 0.075), (0.25, 0.0), (0.0, -0.025)):
        flaws = Imperfections(turn_s=0.1, stamp=stamp)
        shift = sense(flaws, [], moving).points - sense(flaws, [], still).points
        assert shift[:, 0].mean() == pytest.approx(-20.0 * age_s, abs=0.15) and np.abs(shift[:, 1:]).max() < 1e-6


def test_the_second_unit_is_half_a_revolution_behind() -> None:
    moving = replace(actors([[0.0, 10.0, 0.0]]), velocity=np.array([[20.0, 0.0]]))
    sweep = sense(Imperfections(turn_s=0.1, second_unit=1), [], moving)
    first, second = (sweep.points[sweep.beam == beam, 0].mean() for beam in range(2))
    assert abs(second - first) == pytest.approx(1.0, abs=0.1)


def test_motion_that_is_not_taken_out_moves_what_stands() -> None:
    """The agent itself is actor 1, and has no returns; the wall is behind it, passed in the middle of the turn."""
    own = replace(actors([[0.0, 0.0, 0.0]]), velocity=np.array([[20.0, 0.0]]))
    lidar = Lidar(LidarConfig(FLAT, range_noise_m=0.0, dropout_energy=0.0, imperfections=Imperfections(
        turn_s=0.1, uncorrected=0.5)))  # fmt: skip
    scene = RayScene(SceneGeometry(MODELS, [box_part([-15, 0, 5], (1, 2, 10))]).triangles(own))
    sweep = lidar.sense(scene, SE3.identity(), HEIGHT_M, 1, stream(0, "lidar"))
    assert sweep.points[:, 0].mean() == pytest.approx(-14.5 + 0.5 * 20.0 * 0.05, abs=0.02)


def test_reported_intensity_follows_gain_and_gamma() -> None:
    ideal, scaled = sense(None, [ground()]), sense(Imperfections(gain=0.5, gamma=0.5), [ground()])
    np.testing.assert_allclose(scaled.intensity, np.minimum(0.5 * np.sqrt(ideal.intensity), 1), rtol=1e-5)


def test_reported_intensity_follows_offset_and_range() -> None:
    ideal, scaled = sense(None, [ground()]), sense(Imperfections(offset=0.1, fade=1.0), [ground()])
    away_m = np.linalg.norm(ideal.points - [0.0, 0.0, SENSOR_M], axis=1)
    np.testing.assert_allclose(scaled.intensity, ideal.intensity * 15.0 / away_m + 0.1, rtol=1e-4)


def test_a_retro_reflector_blooms_over_what_is_behind_it_and_matt_paint_does_not() -> None:
    """A plate of 0.6 m by 0.5 m at 10 m, at the sensor's height, and a dark wall behind it at 20 m."""
    rows, skirt_rad = BeamPattern("rows", np.arange(-12, 13) * 0.003), 0.002
    wall = box_part([21, 0, 5], (2, 40, 10), reflectivity=0.3)

    def sights(reflectivity: float, skirt_rad: float) -> np.ndarray:
        plate = box_part([10.05, 0, SENSOR_M], (0.1, 0.6, 0.5), reflectivity=reflectivity)
        points = sense(Imperfections(bloom_rad=skirt_rad), [wall, plate], pattern=rows).points
        return points[points[:, 0] < 15]

    crisp, bloomed = sights(220.0, 0.0), sights(220.0, skirt_rad)
    beyond = (np.abs(bloomed[:, 1:] - [0.0, SENSOR_M]) - [0.3, 0.25]).max(axis=1)
    assert len(bloomed) > 1.3 * len(crisp) and beyond.max() > 2 * skirt_rad * 10
    assert (
        beyond.max() < 5.2 * skirt_rad * 10
        and np.abs(np.linalg.norm(bloomed - [0, 0, SENSOR_M], axis=1) - 10).max() < 0.05
    )
    np.testing.assert_array_equal(sights(0.9, skirt_rad), sights(0.9, 0.0))


def test_wrong_values_are_refused() -> None:
    wrongs: list[dict[str, Any]] = [
        {"offset": 1.5},
        {"fade": 3.0},
        {"bloom_rad": -0.1},
        {"roll_rad": 1.0},
        {"lost_share": 1.5},
        {"gain": 0.0},
        {"stamp": -0.1},
        {"edge_rad": 1.0},
    ]
    for wrong in wrongs:
        with pytest.raises(InvalidValueError, match=next(iter(wrong))):
            Imperfections(**wrong)
    with pytest.raises(InvalidValueError, match="imperfections must be"):
        LidarConfig(imperfections=0.1)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="give one"):
        LidarConfig(divergence_rad=0.003, imperfections=Imperfections(edge_rad=0.003))


def test_all_imperfections_cost_less_than_the_five_rays_of_a_wide_beam() -> None:
    flaws = Imperfections(0.01, 0.01, 0.0, 0.003, 0.8, 0.05, 0.5, 0.001, 1, 0.3, 0.5, 0.7, 0.1)
    rows = [[8.0 * k, 6.0 * row, 0.0] for k in range(-12, 13) for row in range(-12, 13) if row]
    static, who = [ground(), box_part([0, 20, 3], (60, 2, 6))], actors(rows)

    def least_s(**config: Any) -> float:
        flaws = config.pop("flaws")
        times = []
        for _ in range(4):
            start = time.process_time()
            sense(flaws, static, who, pattern="HDL-64E", **config)
            times.append(time.process_time() - start)
        return min(times[1:])

    assert least_s(flaws=flaws) < least_s(flaws=None, divergence_rad=0.003)


def test_two_units_of_argoverse_look_up_as_far_as_down() -> None:
    pair, one = PATTERNS.get("2x VLP-32C"), PATTERNS.get("VLP-32C")
    assert len(pair.elevation_rad) == 2 * len(one.elevation_rad) == 64
    np.testing.assert_allclose(np.degrees([pair.elevation_rad.min(), pair.elevation_rad.max()]), [-25.0, 25.0])
