"""Rain, fog and water: dimmed light, echoes of the air itself, and wet surfaces.

Rain dims by 1.076 R^0.67 dB/km, at R mm/h, as measured on optical links (Carbonneau and Wisely, SPIE 3232, 1998; in
ITU-R P.1814), for visible and near infrared light alike. That is 0.6 to 0.85 of the extinction by the drops
below, twice their geometric cross section. Goodin et al. ("Predicting the Influence of Rain on LIDAR in ADAS",
Electronics 2019) have 0.01 R^0.6 per metre, 34 times as much at 10 mm/h, which equals fog of 75 m; their attenuation is
not used, but their range noise, 0.02 r (1 - exp(-R))^2, is. Clutter is drawn drop by drop, as in LISA (Kilic et al.,
arXiv 2107.07004): drops have the sizes and density of Marshall and Palmer (1948), and a drop returns if it covers
enough of the beam.

Fog follows Hahner et al. ("Fog Simulation on Real LiDAR Point Clouds for 3D Object Detection in Adverse Weather", ICCV
2021): it dims by ln(20) / V per metre, V being the visibility (meteorological optical range), and echoes the pulse all
along its way, most in the first metre that the receiver sees. Numbers without a source are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.scene import Singles
from coopsim.support.checks import require_between, require_choice, require_non_negative, require_number

_LIGHT_M_S = 299_792_458.0
_PULSE_S = 20e-9  # half-power width, Hahner et al.
_OVERLAP_M = (0.9, 1.0)  # ranges at which the receiver begins to see the beam and sees all of it; Hahner et al.
_BACKSCATTER = 0.046  # of fog, per steradian, times visibility / m; Hahner et al., after Rasshofer et al. 2011
_TARGET = 1e-6 / np.pi  # differential reflectivity of a target, relative to fog's; Hahner et al.
_FOG_SPREAD = 0.05  # standard deviation of the logarithm of a fog return's range: a thin shell; ours

_DROPS_PER_M3_MM = 8000.0  # Marshall and Palmer
_DROP_REFLECTIVITY = 0.02  # of water, met head-on: ((n - 1) / (n + 1))^2 with n = 1.33; LISA has 1.328
_APERTURE_M = 0.01  # the beam's width at the sensor: Ouster OS1 data sheet
_SPREAD_RAD = 0.003  # the beam's divergence: LISA's, and a Velodyne's to the sides (VLS-128 manual, table F-1)


@dataclass(frozen=True, slots=True)
class Weather:
    """The weather around LiDARs and cameras.

    Attributes:
        rain_mm_h: rain rate: up to 2.5 is light, to 10 moderate, to 50 heavy, beyond violent; at most 200.
        fog_visibility_m: distance at which contrast falls to 5 %; below 1000 m it is called fog. Inf: clear air.
        wetness: share of all surfaces under a film of water, in [0, 1]; see `reflect`.
    """

    rain_mm_h: float = 0.0
    fog_visibility_m: float = np.inf
    wetness: float = 0.0

    def __post_init__(self) -> None:
        require_non_negative(rain_mm_h=self.rain_mm_h)
        require_between(0, 200, rain_mm_h=self.rain_mm_h)
        require_number("a number >= 5, inf for clear air", lambda far: far >= 5, fog_visibility_m=self.fog_visibility_m)
        require_between(0, 1, wetness=self.wetness)

    @property
    def extinction_per_m(self) -> float:
        """Extinction coefficient of light, per metre."""
        rain_db_km = 1.076 * self.rain_mm_h**0.67
        return float(rain_db_km * np.log(10.0) / 10_000 + np.log(20.0) / self.fog_visibility_m)

    @property
    def range_noise_per_m(self) -> float:
        """Standard deviation that rain adds to ranges, as a share of the range."""
        return float(0.02 * np.expm1(-self.rain_mm_h) ** 2)

    @property
    def has_clutter(self) -> bool:
        """Flag of air that itself returns echoes."""
        return self.rain_mm_h > 0 or self.fog_visibility_m < np.inf


WEATHERS = {
    "clear": Weather(),
    "rain": Weather(rain_mm_h=10.0, wetness=1.0),
    "fog": Weather(fog_visibility_m=100.0),
}
"""Weathers by name: dry and clear; the border of moderate and heavy rain; dense fog."""


def as_weather(weather: object) -> Weather | None:
    """Return a `Weather` or None as it is, that of a name in `WEATHERS`, or the one of a mapping of its fields.

    Raises:
        UnknownNameError: there is no weather of that name; the message lists the close ones.
        InvalidValueError: it is none of these, or a field's value is not accepted.
    """
    if isinstance(weather, str):
        require_choice("weather", weather, WEATHERS)
        return WEATHERS[weather]
    made = load(Weather, weather, "weather") if isinstance(weather, Mapping) else weather
    if not (made is None or isinstance(made, Weather)):
        accepted = f"a Weather, a mapping of its fields, None or one of {', '.join(WEATHERS)}"
        raise InvalidValueError(f"weather must be {accepted}, got {weather!r}")
    return made


class WeatherClutter:
    """Echoes of rain and fog in a LiDAR, down to `least_energy`, where a white surface at `reference_range_m` has 1.

    Attributes:
        mean_drops: mean number of detectable drops in a beam that meets nothing else.
    """

    def __init__(self, weather: Weather, reference_range_m: float, least_energy: float, most_m: float) -> None:
        self._extinction = weather.extinction_per_m
        self._range_m = np.linspace(_OVERLAP_M[1], max(most_m, 2 * _OVERLAP_M[1]), 500)
        self._reference_m, self._least = reference_range_m, max(least_energy, 1e-6)
        self._tail_per_mm = 4.1 * max(weather.rain_mm_h, 1e-9) ** -0.21
        self._least_mm = self._smallest_drop_mm(self._range_m)
        beam_m2 = np.pi / 4 * _beam_m(self._range_m) ** 2
        per_m = beam_m2 * _DROPS_PER_M3_MM / self._tail_per_mm * np.exp(-self._tail_per_mm * self._least_mm)
        per_m *= weather.rain_mm_h > 0
        steps = np.diff(self._range_m) * (per_m[1:] + per_m[:-1]) / 2
        self._expected = np.concatenate([[0.0], np.cumsum(steps)])  # detectable drops up to each range
        self.mean_drops = float(self._expected[-1])
        self._fog_m, self._fog_energy = _fog_echo(weather.fog_visibility_m, self._extinction, reference_range_m)

    def draw(self, rays: int, rng: np.random.Generator) -> tuple[Singles, Singles]:
        """Draw range (m, inf for none) and energy of the air's strongest echo, for each of a number of rays."""
        chance, size = rng.standard_exponential((2, rays))
        fog_m = self._fog_m * np.exp(_FOG_SPREAD * rng.standard_normal(rays))
        met = np.flatnonzero(chance < self.mean_drops)
        drop_m = np.interp(chance[met], self._expected, self._range_m)  # the nearest of a Poisson process
        least_mm = self._smallest_drop_mm(drop_m)
        energy = self._least * (1.0 + size[met] / (self._tail_per_mm * least_mm)) ** 2
        foggy = self._fog_energy >= self._least
        range_m = np.where(foggy, fog_m, np.inf).astype(np.float32)
        strongest = np.full(rays, self._fog_energy if foggy else 0.0, np.float32)
        met, drop_m, energy = (array[energy > strongest[met]] for array in (met, drop_m, energy))
        range_m[met], strongest[met] = drop_m, energy
        return range_m, strongest

    def _smallest_drop_mm(self, range_m: Floats) -> Floats:
        """Return the diameter of a drop with the least energy; a drop covers (diameter / beam)^2 of the beam."""
        dimmed = np.exp(-2 * self._extinction * range_m)
        seen = _DROP_REFLECTIVITY * dimmed * (self._reference_m / range_m) ** 2
        diameter_mm: Floats = 1e3 * _beam_m(range_m) * np.sqrt(self._least / seen)
        return diameter_mm


def _beam_m(range_m: Floats) -> Floats:
    return _APERTURE_M + _SPREAD_RAD * range_m


def _fog_echo(visibility_m: float, extinction_per_m: float, reference_range_m: float) -> tuple[float, float]:
    """Return range and energy of fog's strongest echo: Hahner et al., eq. 12, for a pulse cos^2(pi t / (2 width)).

    Time is counted from the pulse's peak, as a sensor's ranges are, and not from its beginning as in the paper, whose
    code (generate_integral_lookup_table.py) shifts ranges by the same three metres.
    """
    if visibility_m == np.inf:
        return np.inf, 0.0
    range_m, passed_s = np.linspace(0.0, 30.0, 301)[:, None], np.linspace(-_PULSE_S, _PULSE_S, 401)
    there_m = range_m - _LIGHT_M_S * passed_s / 2
    overlap = np.clip((there_m - _OVERLAP_M[0]) / (_OVERLAP_M[1] - _OVERLAP_M[0]), 0.0, 1.0)
    pulse = np.cos(np.pi * passed_s / (2 * _PULSE_S)) ** 2
    held = np.exp(-2 * extinction_per_m * there_m) * overlap / np.maximum(there_m, _OVERLAP_M[0]) ** 2
    echo = np.trapezoid(pulse * held, passed_s, axis=1)
    best = int(echo.argmax())
    backscatter = _BACKSCATTER / visibility_m
    return float(range_m[best, 0]), float(reference_range_m**2 * backscatter / _TARGET * echo[best])
