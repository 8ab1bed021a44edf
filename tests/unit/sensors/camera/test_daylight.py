"""Light: what hour and weather make of colours, by the laws that they are said to follow."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sensor_scenes import Studio, actors, box_part, ground

from coopsim.errors import CoopsimError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, GAMMA, Daylight, Illumination, as_daylight
from coopsim.sensors.weather import Weather
from coopsim.world.snapshot import AgentBody

DAY = DAYLIGHTS.get("day")
BODY = {"cav_0": AgentBody("cav_0", "cav", None, SE3.identity(), 1.6)}


def picture(daylight: Daylight = DAY, weather: Weather | None = None, static: Any = ()) -> np.ndarray:
    studio = Studio(
        "raycast", static, cameras={"cav_0": [Camera("front")]}, illumination=Illumination(daylight, weather)
    )
    rgb = studio.shoot(actors([]), BODY)["cav_0"]["front"].rgb
    assert rgb is not None
    return rgb.astype(int)


def wall(distance_m: float) -> Any:
    return [box_part([distance_m + 0.5, 0.0, 0.0], (1.0, 900.0, 900.0))]


def test_nights_are_darker_than_dusks_than_days() -> None:
    day, dusk, night = (picture(DAYLIGHTS.get(name), static=[ground()]).mean() for name in ("day", "dusk", "night"))
    assert day > 1.3 * dusk > 0 and dusk > 4 * night > 0


def test_a_face_towards_the_sun_is_brighter_and_of_its_hue() -> None:
    low_red = Daylight(0.0, 0.0001, (0.8, 0.1, 0.1), (0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    white = np.full((2, 3), 255, dtype=np.uint8)
    facing, averted = Illumination(low_red).shade(white, np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(facing, [0.9, 0.2, 0.2], atol=1e-3)
    np.testing.assert_allclose(averted, 0.1, atol=1e-6)


def test_a_sun_below_the_horizon_lights_nothing() -> None:
    set_sun = Daylight(0.0, -0.1, (1.0, 1.0, 1.0), (0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    light = Illumination(set_sun).shade(np.full((1, 3), 255, dtype=np.uint8), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(light, 0.1, atol=1e-6)


def test_contrast_falls_to_a_twentieth_at_the_visibility() -> None:
    """Koschmieder: what is left of the difference between a wall and the air's own light."""
    weather = Weather(fog_visibility_m=40.0)
    airlight = (picture(DAY, weather)[90, 160] / 255.0) ** GAMMA

    def contrast(distance_m: float) -> Any:
        return (picture(DAY, weather, wall(distance_m))[90, 160] / 255.0) ** GAMMA - airlight

    np.testing.assert_allclose(contrast(40.5) / contrast(0.5), 0.05, atol=0.02)  # pictures have 8 bits
    assert np.abs(contrast(150.0)).max() < 0.005


def test_fog_thickens_along_the_ray_and_not_the_optical_axis() -> None:
    rgb = picture(DAY, Weather(fog_visibility_m=30.0), wall(10.0))
    assert (rgb[0, 0] > rgb[90, 160] + 5).all()  # the corner of the view is farther away, so brighter


@pytest.mark.parametrize("weather", [Weather(rain_mm_h=20.0), Weather(wetness=1.0)])
def test_rain_and_wetness_darken(weather: Weather) -> None:
    dry, wet = picture(static=[ground()]), picture(weather=weather, static=[ground()])
    assert (wet[170] < 0.9 * dry[170]).all()


def test_dark_surfaces_darken_most_when_wet_and_white_ones_not() -> None:
    """To 1 / n^2 of their light at the least, the share that leaves the water again."""
    grey, up = np.array([[10, 80, 255]], dtype=np.uint8), np.array([[0.0, 0.0, 1.0]])
    ratio = Illumination(DAY, Weather(wetness=1.0)).shade(grey, up) / Illumination(DAY).shade(grey, up)
    assert ratio[0, 0] == pytest.approx(1 / 1.33**2, abs=0.001)
    assert ratio[0, 0] < ratio[0, 1] < 0.65 and ratio[0, 2] == pytest.approx(1.0)


def test_the_names_of_hours() -> None:
    assert as_daylight("dusk") is DAYLIGHTS.get("dusk") and as_daylight(DAY) is DAY
    for bad in ("nigth", None, 12):
        with pytest.raises(UnknownNameError, match="unknown time_of_day"):
            as_daylight(bad)


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"sun_elevation_rad": 2.0}, "sun_elevation_rad must be in"),
        ({"sun_azimuth_rad": np.nan}, "sun_azimuth_rad must be a finite number"),
        ({"sun": (1.0, 1.0)}, "sun must have shape"),
        ({"ambient": (0.1, -0.1, 0.1)}, "ambient must be >= 0"),
        ({"sky": (np.inf, 0.0, 0.0)}, "sky must be finite"),
    ],
)
def test_bad_light_is_refused(bad: dict[str, Any], match: str) -> None:
    good = {"sun_azimuth_rad": 0.0, "sun_elevation_rad": 1.0, "sun": (1, 1, 1), "ambient": (0, 0, 0), "sky": (0, 0, 1)}
    with pytest.raises(CoopsimError, match=match):
        Daylight(**(good | bad))


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"rain_mm_h": -1.0}, "rain_mm_h must be"),
        ({"rain_mm_h": 500.0}, r"rain_mm_h must be in \[0, 200\]"),
        ({"fog_visibility_m": 0.0}, "fog_visibility_m must be a number >= 5"),
        ({"fog_visibility_m": np.nan}, "fog_visibility_m"),
        ({"wetness": 2}, r"wetness must be in \[0, 1\]"),
    ],
)
def test_bad_weather_is_refused(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        Weather(**bad)
