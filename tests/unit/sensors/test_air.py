"""Rain, fog and water: what is lost, what comes back, and by which law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sensor_scenes import box_part, ground, triangles

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.rng import stream
from coopsim.sensors.air import Clutter, Weather
from coopsim.sensors.lidar import Lidar, LidarConfig
from coopsim.sensors.raycast import RayScene
from coopsim.sensors.returns import CLUTTER_ID, reflect
from coopsim.types import Sweep

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


def test_attenuation_follows_goodin_and_hahner() -> None:
    assert Weather(rain_mm_h=10.0).extinction_per_m == pytest.approx(0.01 * 10**0.6)
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
def test_worse_weather_leaves_less_and_nearer(light: Weather, heavy: Weather) -> None:
    counts = [real(sense(weather)).sum() for weather in (None, light, heavy)]
    assert counts[0] > counts[1] > counts[2] > 0
    reach = [np.percentile(np.linalg.norm(s.points[real(s)], axis=1), 95) for s in map(sense, (None, light, heavy))]
    assert reach[0] > reach[1] > reach[2]


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


def test_drops_are_a_poisson_process_of_what_can_be_told() -> None:
    clutter = Clutter(Weather(rain_mm_h=30.0), 50.0, 0.02, 120.0)
    range_m, energy = clutter.draw(200_000, np.random.default_rng(0))
    expected = clutter.mean_drops
    assert np.isfinite(range_m).mean() == pytest.approx(-np.expm1(-expected), abs=0.005)
    assert (energy[np.isfinite(range_m)] >= 0.02 - 1e-6).all() and (energy[np.isinf(range_m)] == 0).all()
    fewer = Clutter(Weather(rain_mm_h=3.0), 50.0, 0.02, 120.0).mean_drops
    blunt = Clutter(Weather(rain_mm_h=30.0), 50.0, 0.2, 120.0).mean_drops
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
