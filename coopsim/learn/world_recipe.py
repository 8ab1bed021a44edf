"""What the clips of a training are drawn from: places, agents, sensors, weather."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from coopsim.catalog import is_scenario_file, scenario_files
from coopsim.config.load import load, read_mapping
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_flag,
    require_frame_time,
    require_non_negative,
    require_positive,
    require_probability,
)
from coopsim.world.scenario import SCENARIOS
from coopsim.world.towns.town_options import TownOptions
from coopsim.world.towns.town_scenarios import TOWN

_TEST_LIDARS = ("VLP-16", "OS1-128")
_COUNTS = ("cars", "masts", "drones", "buses")
_RANGES = ("start_s", "density", "truck_share", "rain_mm_h", "fog_visibility_m", "range_noise_m")
_SHARES = ("plain_share", "drone_share", "rain_share", "fog_share")
_FARTHEST_PLACE = 2**62


@dataclass(frozen=True, slots=True, eq=True)
class WorldRecipe:
    """What each clip is drawn from; the defaults are those of an encoder's training (stage A).

    A range is a pair of its ends, both of which may be drawn; numbers in it are equally likely unless
    it says otherwise.

    Attributes:
        environments: "town" or paths of scenario files, of which each clip takes one.
        first_place: seed of the first town: clips are in the towns of `first_place` to `first_place + places - 1`.
        places: number of towns.
        junctions: number of places where streets meet, of all towns; None: drawn for each, as are the next two.
        openness: how far one can see past corners, in [0, 1].
        lanes: most lanes a direction.
        plain_share: share of the clips without street furniture.
        frames: frames of a clip.
        dt_s: times between two frames, of which each clip takes one.
        start_s: range of the time that traffic has run when a clip begins.
        lidars: names of beam tables, with their weights.
        range_noise_m: range of the LiDARs' standard deviation along the ray.
        cars: range of the number of connected cars.
        masts: range of the number of roadside units.
        drones: range of the number of drones, where there are any.
        drone_share: share of the clips in which there are.
        density: range of the factor on the numbers of vehicles and people.
        truck_share: range of the share of trucks among the vehicles.
        buses: range of the number of buses, which towns have none of otherwise.
        rain_share: share of the clips with rain.
        rain_mm_h: range of its rate.
        fog_share: share of the clips with fog.
        fog_visibility_m: range of the visibility in it; its logarithm is uniform.
        allow_test_places: accept also what results are measured on and no shipped network was trained on: the named
            scenarios, the shipped scenario files, and the sensors VLP-16 and OS1-128.
    """

    environments: Sequence[str] = (TOWN,)
    first_place: int = 100_000
    places: int = 1_000_000
    junctions: int | None = None
    openness: float | None = None
    lanes: int | None = None
    plain_share: float = 0.25
    frames: int = 6
    dt_s: Sequence[float] = (1.0,)
    start_s: Sequence[float] = (0.0, 20.0)
    lidars: Mapping[str, float] = field(default_factory=lambda: {"HDL-32E": 0.8, "HDL-64E": 0.2})
    range_noise_m: Sequence[float] = (0.01, 0.04)
    cars: Sequence[int] = (1, 4)
    masts: Sequence[int] = (0, 2)
    drones: Sequence[int] = (1, 1)
    drone_share: float = 0.15
    density: Sequence[float] = (0.6, 1.6)
    truck_share: Sequence[float] = (0.05, 0.3)
    buses: Sequence[int] = (0, 2)
    rain_share: float = 0.2
    rain_mm_h: Sequence[float] = (0.5, 25.0)
    fog_share: float = 0.1
    fog_visibility_m: Sequence[float] = (60.0, 600.0)
    allow_test_places: bool = False

    def __post_init__(self) -> None:
        require_flag(allow_test_places=self.allow_test_places)
        for name in ("environments", "dt_s", *_COUNTS, *_RANGES):
            object.__setattr__(self, name, _several(name, getattr(self, name)))
        self._check_lidars()
        self._check_ranges()
        require_count(1, frames=self.frames, places=self.places)
        require_count(0, _FARTHEST_PLACE - self.places, first_place=self.first_place)
        require_probability(**{name: getattr(self, name) for name in _SHARES})
        for one in self.dt_s:
            require_frame_time(one)
        TownOptions(self.junctions, self.openness, self.lanes)  # its own checks
        for name in self.environments:
            self._check_environment(name)
        self._as_floats()

    @classmethod
    def for_fusion(cls, **changed: Any) -> WorldRecipe:
        """Return the recipe for training a fusion (stages B and C): at least two agents, and frames close in time.

        Args:
            **changed: fields that differ from that.
        """
        usual: dict[str, Any] = {"dt_s": (0.1, 0.2, 0.3, 0.4, 0.5), "cars": (2, 3), "start_s": (0.0, 25.0)}
        return cls(**{**usual, **changed})

    @classmethod
    def for_validation(cls, **changed: Any) -> WorldRecipe:
        """Return the recipe of validation: towns 1000 to 1099, three cars and one or two masts, HDL-32E, dry air.

        Args:
            **changed: fields that differ from that.
        """
        usual: dict[str, Any] = {
            "first_place": 1000,
            "places": 100,
            "frames": 4,
            "dt_s": (0.5,),
            "lidars": {"HDL-32E": 1.0},
            "range_noise_m": (0.02, 0.02),
            "cars": (3, 3),
            "masts": (1, 2),
            "drone_share": 0.0,
            "density": (1.0, 1.0),
            "rain_share": 0.0,
            "fog_share": 0.0,
        }
        return cls(**{**usual, **changed})

    @classmethod
    def of(cls, given: WorldRecipe | Mapping[str, Any] | str | Path) -> WorldRecipe:
        """Return the recipe that is given as itself, as a mapping of its fields, or as the path of a YAML file.

        Raises:
            InvalidValueError: it is none of these, or a value is not accepted.
            UnknownNameError: there is no such field.
        """
        if isinstance(given, cls):
            return given
        recipe: WorldRecipe = load(cls, read_mapping("world", "a WorldRecipe", given), "world")
        return recipe

    def with_frames(self, frames: int) -> WorldRecipe:
        """Return the recipe with clips of so many frames."""
        return replace(self, frames=frames)

    def as_mapping(self) -> dict[str, Any]:
        """Return the fields as plain data, which `of` reads."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    def _check_environment(self, name: object) -> None:
        if not isinstance(name, str):
            raise InvalidValueError(f"environments must be names or paths of scenario files, got {name!r}")
        if name == TOWN:
            return
        is_file = is_scenario_file(name)
        if not is_file:
            require_choice("environment", name, (TOWN, *SCENARIOS))
        if self.allow_test_places or (is_file and Path(name).name not in scenario_files()):
            return
        raise InvalidValueError(
            f"environments must not be {name!r}, which is a test place: results are measured on the named scenarios "
            f"and the shipped files, so nothing is trained on them. Accepted: {TOWN!r}, scenario files of your own, or "
            "this one with allow_test_places: true"
        )

    def _check_lidars(self) -> None:
        if not isinstance(self.lidars, Mapping) or not self.lidars:
            raise InvalidValueError(f"lidars must be a mapping of beam tables to weights, got {self.lidars!r}")
        object.__setattr__(self, "lidars", dict(self.lidars))
        for name, weight in self.lidars.items():
            require_choice("lidar", name, PATTERNS)
            require_positive(**{f"the weight of {name}": weight})
            if name in _TEST_LIDARS and not self.allow_test_places:
                raise InvalidValueError(
                    f"lidars must not have {name!r}, which is a test sensor: results are measured on it untrained; it "
                    "is accepted with allow_test_places: true"
                )

    def _as_floats(self) -> None:
        """Make floats of the numbers that need not be whole, as a file's 25: equal recipes are written alike."""
        for name in ("dt_s", *_RANGES):
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        for name in _SHARES:
            object.__setattr__(self, name, float(getattr(self, name)))
        object.__setattr__(self, "lidars", {name: float(weight) for name, weight in self.lidars.items()})

    def _check_ranges(self) -> None:
        for name in _COUNTS:
            for end in getattr(self, name):
                require_count(0, **{name: end})
        for name in _RANGES:
            for end in getattr(self, name):
                require_non_negative(**{name: end})
        for name in (*_COUNTS, *_RANGES):
            ends = getattr(self, name)
            if len(ends) != 2 or ends[0] > ends[1]:
                raise InvalidValueError(f"{name} must be a pair of numbers, the smaller first, got {list(ends)}")
        require_between(0, 200, rain_mm_h=self.rain_mm_h[1])
        require_between(5, 100_000, fog_visibility_m=self.fog_visibility_m[0])
        require_between(0, 1, truck_share=self.truck_share[1])
        if not (self.cars[0] or self.masts[0]):
            raise InvalidValueError("cars or masts must be at least 1, so that every clip has an agent")


def _several(name: str, given: Any) -> tuple[Any, ...]:
    """Return values as a tuple."""
    if isinstance(given, (str, bytes, Mapping)) or not isinstance(given, Sequence) or not given:
        raise InvalidValueError(f"{name} must be a list of values, got {given!r}")
    return tuple(given)
