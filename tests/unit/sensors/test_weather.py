"""Rain, fog and water: losses and echoes follow their laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from sensor_scenes import box_part, ground, triangles

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.lidar.returns import CLUTTER_ID, reflect
from coopsim.sensors.scene import RayScene
from coopsim.sensors.weather import Weather, WeatherClutter
from coopsim.support.rng import stream
from coopsim.types import Sweep

SWEEP_FIELDS = ("points", "intensity", "beam", "instance")
WALLS = [box_part([x, 0.0, 5.0], (0.2, 40.0, 10.0), reflectivity=0.5) for x in (-60.0, 20.0)]
SCENE = RayScene(triangles(static=[ground(), *WALLS]))


def sense(weather: Weather | None = None, **config: Any) -> Sweep:
    lidar = Lidar(LidarConfig(**({"columns": 512} | config)), weather)
    return lidar.sense(SCENE, SE3.identity(), 1.65, None, stream(0, "lidar"))


def real(sweep: Sweep) -> np.ndarray:
    return sweep.instance != CLUTTER_ID


def test_clear_air_changes_nothing() -> None:
    for weather in (None, Weather(), Weather(rain_mm_h=0.0, fog_visibility_m=np.inf)):
        np.testing.assert_array_equal(sense(weather).points, sense().points)


@pytest.mark.parametrize("rain_mm_h", [0.5, 2.5, 10.0, 50.0, 200.0])
def test_rain_dims_by_somewhat_less_than_what_its_drops_take(rain_mm_h: float) -> None:
    """Marshall and Palmer's drops by Beer and Lambert; large ones take twice their cross section."""
    mm = np.linspace(0.0, 20.0, 4001)
    drops_per_m3_mm = 8000.0 * np.exp(-4.1 * rain_mm_h**-0.21 * mm)
    by_geometry_per_m = np.trapezoid(2 * np.pi / 4 * (1e-3 * mm) ** 2 * drops_per_m3_mm, mm)
    extinction = Weather(rain_mm_h=rain_mm_h).extinction_per_m
    assert 0.6 * by_geometry_per_m < extinction < by_geometry_per_m
    assert 10 * 1000 * extinction / np.log(10) == pytest.approx(1.076 * rain_mm_h**0.67)


def test_returns_are_dimmed_there_and_back() -> None:
    assert np.exp(-Weather(fog_visibility_m=200.0).extinction_per_m * 200.0) == pytest.approx(0.05)
    weather = Weather(rain_mm_h=2.0, fog_visibility_m=100.0)
    exact: dict[str, Any] = {"range_noise_m": 0.0, "dropout_energy": 0.0}
    clear, foggy = sense(**exact), sense(weather, **exact)
    wall = (np.abs(clear.points[:, 0] - 19.9) < 1e-3) & (np.abs(clear.points[:, 1]) < 1)
    kept = (np.abs(foggy.points[:, 0] - 19.9) < 2) & (np.abs(foggy.points[:, 1]) < 1) & real(foggy)
    range_m = np.linalg.norm(clear.points[wall] - [0, 0, 2.0], axis=1)
    dimmed = clear.intensity[wall] * np.exp(-2 * weather.extinction_per_m * range_m)
    assert foggy.intensity[kept].mean() == pytest.approx(dimmed.mean(), rel=0.05)


@pytest.mark.parametrize(
    ("light", "heavy"),
    [
        (Weather(rain_mm_h=2.0), Weather(rain_mm_h=30.0)),
        (Weather(fog_visibility_m=500.0), Weather(fog_visibility_m=50.0)),
    ],
)
def test_worse_weather_leaves_fewer_returns_and_dimmer(light: Weather, heavy: Weather) -> None:
    sweeps = [sense(weather) for weather in (None, light, heavy)]
    for left in ([real(s).sum() for s in sweeps], [s.intensity[real(s)].mean() for s in sweeps]):
        assert left[0] > left[1] > left[2] > 0


def wall_returns(weather: Weather, range_m: float) -> Sweep:
    """Twenty sweeps of 200 rays each, all of which meet a wall, albedo 0.5, at a range."""
    scene = RayScene(triangles(static=[box_part([range_m + 0.1, 0.0, 0.0], (0.2, 20.0, 20.0), reflectivity=0.5)]))
    straight = BeamPattern("straight", np.radians(np.linspace(-1.0, 1.0, 200)))
    lidar, rng = Lidar(LidarConfig(straight, columns=1, max_range_m=1000.0), weather), stream(0, "lidar")
    sweeps = [lidar.sense(scene, SE3.identity(), 0.0, None, rng) for _ in range(20)]
    return Sweep(*(np.concatenate([getattr(s, name) for s in sweeps]) for name in SWEEP_FIELDS))


def range_of_energy(energy: float, weather: Weather) -> float:
    """Return the range at which a wall of albedo 0.5 has an energy, by the LiDAR equation."""
    return float(brentq(lambda r: 0.5 * (50.0 / r) ** 2 * np.exp(-2 * weather.extinction_per_m * r) - energy, 1, 1e3))


@pytest.mark.parametrize("weather", [Weather(), Weather(50.0), *(Weather(0.0, v) for v in (100.0, 200.0, 500.0))])
def test_half_of_the_returns_are_lost_where_the_lidar_equation_says(weather: Weather) -> None:
    """Except in beams where a drop outshines the wall, whose energy there is below that of any detectable drop."""
    sweep = wall_returns(weather, range_of_energy(0.02 * np.log(2), weather))
    drops = WeatherClutter(weather, 50.0, 0.02, 1000.0).mean_drops
    assert real(sweep).sum() / 4000 == pytest.approx(0.5 * np.exp(-drops), abs=0.03)


@pytest.mark.parametrize("visibility_m", [20.0, 30.0, 50.0])
def test_thick_fog_outshines_what_is_about_as_far_as_one_sees(visibility_m: float) -> None:
    weather = Weather(fog_visibility_m=visibility_m)
    _, energy = WeatherClutter(weather, 50.0, 0.02, 120.0).draw(1, np.random.default_rng(0))
    reach_m = range_of_energy(float(energy[0]), weather)
    assert 0.5 * visibility_m < reach_m < visibility_m
    assert real(wall_returns(weather, 0.97 * reach_m)).all() and not real(wall_returns(weather, 1.03 * reach_m)).any()


def test_fog_returns_from_where_the_receiver_begins_to_see() -> None:
    """Within a pulse's length, at ranges counted from the pulse's peak."""
    for visibility_m in (10.0, 50.0):
        sweep = wall_returns(Weather(fog_visibility_m=visibility_m), 500.0)
        range_m = np.linalg.norm(sweep.points - [0.0, 0.0, 0.35], axis=1)
        assert len(range_m) > 2000 and not real(sweep).any()
        assert range_m.min() >= 1.0 and range_m.max() < 2.5


def test_rain_makes_ranges_noisier_in_proportion() -> None:
    rain = Weather(rain_mm_h=20.0)
    assert rain.range_noise_per_m == pytest.approx(0.02, rel=1e-6)
    sweep = sense(rain, range_noise_m=0.0, dropout_energy=0.0)
    near = real(sweep) & (np.abs(sweep.points[:, 1]) < 4) & (sweep.points[:, 0] > 15) & (sweep.points[:, 2] > 0.5)
    off = np.linalg.norm(sweep.points[near] - [0, 0, 2.0], axis=1)
    want = off / sweep.points[near, 0] * 19.9
    assert ((off - want) / want).std() == pytest.approx(0.02, rel=0.15)


def test_clutter_is_near_and_where_nothing_stronger_returns() -> None:
    for weather in (Weather(rain_mm_h=50.0), Weather(fog_visibility_m=40.0)):
        sweep = sense(weather)
        clutter = sweep.points[~real(sweep)] - [0, 0, 2.0]
        assert len(clutter) > 50
        assert np.percentile(np.linalg.norm(clutter, axis=1), 95) < 15.0
        ahead = real(sweep) & (sweep.points[:, 0] > 0)
        assert ahead.sum() > 10  # the near wall is stronger than the air


def test_light_haze_returns_nothing_itself() -> None:
    assert real(sense(Weather(fog_visibility_m=1000.0))).all()


def test_detectable_drops_are_a_poisson_process() -> None:
    clutter = WeatherClutter(Weather(rain_mm_h=30.0), 50.0, 0.02, 120.0)
    range_m, energy = clutter.draw(200_000, np.random.default_rng(0))
    expected = clutter.mean_drops
    assert np.isfinite(range_m).mean() == pytest.approx(-np.expm1(-expected), abs=0.005)
    assert (energy[np.isfinite(range_m)] >= 0.02 - 1e-6).all() and (energy[np.isinf(range_m)] == 0).all()
    fewer = WeatherClutter(Weather(rain_mm_h=3.0), 50.0, 0.02, 120.0).mean_drops
    blunt = WeatherClutter(Weather(rain_mm_h=30.0), 50.0, 0.2, 120.0).mean_drops
    assert expected > 1.5 * fewer and expected > 2 * blunt


def test_every_sweep_takes_as_many_draws_whatever_it_meets() -> None:
    lidar, states = Lidar(LidarConfig(columns=64), Weather(rain_mm_h=5.0, fog_visibility_m=80.0)), []
    for scene in (SCENE, RayScene(triangles())):
        rng = stream(1, "lidar")
        lidar.sense(scene, SE3.identity(), 1.65, None, rng)
        states.append(rng.random())
    assert states[0] == states[1]


def test_wet_is_darker_and_more_so_aslant() -> None:
    face, albedo = np.zeros(50, dtype=np.int64), np.array([0.3])
    cosine = np.linspace(0.02, 1.0, 50).astype(np.float32)
    dry, damp, wet = (reflect(face, cosine, albedo, wetness) for wetness in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(dry, 0.3 * cosine, rtol=1e-6)
    np.testing.assert_allclose(damp, (dry + wet) / 2, rtol=1e-5)
    head_on = 0.3 / (1.33**2 * 0.7 + 0.3) * (1 - (0.33 / 2.33) ** 2) ** 2
    assert wet[-1] == pytest.approx(head_on, rel=1e-5)
    assert (np.diff(wet / dry) > -1e-6).all() and wet[0] / dry[0] < 0.1 * wet[-1] / dry[-1]


def test_wet_ground_is_seen_less_far() -> None:
    dry, wet = sense(), sense(Weather(wetness=1.0))
    assert len(wet) < len(dry)
    flat = [np.linalg.norm(s.points[s.points[:, 2] < 0.1], axis=1) for s in (dry, wet)]
    assert np.percentile(flat[1], 95) < np.percentile(flat[0], 95)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"rain_mm_h": -1.0}, "rain_mm_h must be"),
        ({"rain_mm_h": 500.0}, r"rain_mm_h must be in \[0, 200\]"),
        ({"fog_visibility_m": 0.0}, "fog_visibility_m must be a number >= 5, inf for clear air"),
        ({"fog_visibility_m": None}, "fog_visibility_m must be"),
        ({"wetness": 1.5}, r"wetness must be in \[0, 1\]"),
    ],
)
def test_bad_weather_is_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        Weather(**bad)
