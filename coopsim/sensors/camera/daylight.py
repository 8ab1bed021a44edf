"""Light of a scene: the hour's sun and sky, dimmed by rain and fog. Light is linear, images are sRGB."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.weather import Weather
from coopsim.support.arrays import frozen, require_finite
from coopsim.support.checks import require_between, require_finite_number
from coopsim.support.registry import Registry
from coopsim.world.models.surfaces import wet_albedo

RGB = tuple[float, float, float]

GAMMA = 2.2
_CLOUDED_MM_H = 2.0  # e-folding rain rate from a clear sky to a closed one; ours
_CLOUDY_AMBIENT, _CLOUDY_SKY = 0.55, 0.35  # of their clear values, under a closed sky; ours
_FOG_M = 1000.0  # visibility below which haze is called fog (WMO)
_SOAKED_MM_H = 1.0  # e-folding rain rate from dry surfaces to wet ones; ours


@dataclass(frozen=True, slots=True)
class Daylight:
    """Sun (or moon) and sky. Light of 1 shows a white surface white.

    Attributes:
        sun_azimuth_rad: counter-clockwise from the world's x.
        sun_elevation_rad: over the horizon, in [-pi/2, pi/2]; a sun below the horizon lights nothing.
        sun: red, green and blue light on a surface that faces the sun, >= 0.
        ambient: light from all around, >= 0.
        sky: color of the empty sky, >= 0.
    """

    sun_azimuth_rad: float
    sun_elevation_rad: float
    sun: RGB
    ambient: RGB
    sky: RGB

    def __post_init__(self) -> None:
        require_finite_number(sun_azimuth_rad=self.sun_azimuth_rad)
        require_between(-np.pi / 2, np.pi / 2, sun_elevation_rad=self.sun_elevation_rad)
        for name in ("sun", "ambient", "sky"):
            light = frozen(getattr(self, name), (3,), np.float64, name)
            require_finite(light, name)
            if (light < 0).any():
                raise InvalidValueError(f"{name} must be >= 0 in red, green and blue, got {getattr(self, name)!r}")

    @property
    def towards_sun(self) -> Floats:
        """Unit vector towards the sun (3,), world frame."""
        level = np.cos(self.sun_elevation_rad)
        azimuth = self.sun_azimuth_rad
        return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(self.sun_elevation_rad)])


# Made to look like their hour; of no certain place.
DAYLIGHTS: Registry[Daylight] = Registry("time_of_day")
DAYLIGHTS.register("day")(Daylight(0.62, 1.12, (0.5, 0.5, 0.5), (0.55, 0.55, 0.55), (0.40, 0.56, 0.74)))
DAYLIGHTS.register("dusk")(Daylight(2.9, 0.10, (0.62, 0.30, 0.12), (0.17, 0.16, 0.21), (0.52, 0.26, 0.20)))
DAYLIGHTS.register("night")(Daylight(-1.1, 0.70, (0.012, 0.015, 0.022), (0.012, 0.015, 0.024), (0.004, 0.006, 0.013)))


class Illumination:
    """Daylight in some weather.

    Rain clouds hide the sun and dim the sky, and wet surfaces are darker. Through air of extinction b per metre
    (`Weather.extinction_per_m`), a surface at distance r shows the share exp(-b r) of its light; the rest is the sky's
    light (Koschmieder 1924).
    """

    def __init__(self, daylight: Daylight, weather: Weather | None = None) -> None:
        weather = weather or Weather()
        clear = np.exp(-weather.rain_mm_h / _CLOUDED_MM_H)
        self._wet = max(weather.wetness, float(-np.expm1(-weather.rain_mm_h / _SOAKED_MM_H)))
        self._towards_sun = daylight.towards_sun
        self._sun = np.array(daylight.sun) * clear * (daylight.sun_elevation_rad > 0)
        self._ambient = np.array(daylight.ambient) * (clear + _CLOUDY_AMBIENT * (1 - clear))
        # A closed sky, and one behind fog, has no hue of its own.
        self.extinction_per_m = weather.extinction_per_m
        sky = np.array(daylight.sky)
        grey = max(1 - clear, min(1.0, _FOG_M / weather.fog_visibility_m))
        hueless = sky + grey * (sky.mean() - sky)
        self.sky: Floats = hueless * (clear + _CLOUDY_SKY * (1 - clear))

    def shade(self, color: NDArray[np.uint8], normals: Floats) -> NDArray[np.float32]:
        """Return the linear light (F, 3) from matt faces with these colours (F, 3) and outward unit normals (F, 3)."""
        facing = np.maximum(normals @ self._towards_sun, 0.0)[:, None]
        albedo = (color / 255.0) ** GAMMA
        albedo += self._wet * (wet_albedo(albedo) - albedo)
        light: NDArray[np.float32] = (albedo * (self._ambient + facing * self._sun)).astype(np.float32)
        return light


def to_srgb(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Convert linear light to sRGB, whose curve is approximated by a power of 2.2."""
    shown: NDArray[np.uint8] = (255 * np.clip(light, 0.0, 1.0) ** np.float32(1 / GAMMA)).astype(np.uint8)
    return shown


def as_daylight(time_of_day: object) -> Daylight:
    """Return a `Daylight` as it is, or the one of that name."""
    if isinstance(time_of_day, Daylight):
        return time_of_day
    if not isinstance(time_of_day, str):
        raise UnknownNameError("time_of_day", time_of_day, DAYLIGHTS.names())
    return DAYLIGHTS.get(time_of_day)
