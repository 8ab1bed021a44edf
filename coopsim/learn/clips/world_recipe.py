"""Recipes of clips: the ranges of places, agents, sensors and weather, with their checks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any

from coopsim.catalog import is_recordings_folder, is_scenario_file, scenario_files
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.ranges import as_count_range, as_list, as_range
from coopsim.learn.clips.sensor_ranges import SensorRanges
from coopsim.sensors import FARTHEST_MOUNT_M
from coopsim.sensors.camera.camera import RIG_NAMES
from coopsim.sensors.camera.daylight import DAYLIGHTS
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.support.checks import (
    require_choice,
    require_count,
    require_flag,
    require_frame_time,
    require_instance,
    require_positive,
    require_probability,
)
from coopsim.world.drawn_options import TownOptions
from coopsim.world.drawn_places import TOWN
from coopsim.world.scenario import SCENARIOS

_COUNTS = ("cars", "masts", "drones", "buses")
_RANGES = {
    "start_s": (0.0, 3600.0),
    "density": (0.0, 100.0),
    "truck_share": (0.0, 1.0),
    "rain_mm_h": (0.0, 200.0),
    "fog_visibility_m": (5.0, 100_000.0),
    "range_noise_m": (0.0, 10.0),
    "camera_fov_deg": (20.0, 150.0),
    "camera_turn_deg": (-180.0, 180.0),
    "camera_pitch_deg": (-90.0, 90.0),
    "camera_above_m": (-FARTHEST_MOUNT_M, FARTHEST_MOUNT_M),
}
"""Limits of the ends of ranges."""
_SHARES = (
    "plain_share",
    "street_share",
    "left_hand_share",
    "realistic_share",
    "drone_share",
    "rain_share",
    "fog_share",
    "distorted_share",
)
_LATER = ("sensors", "street_share", "left_hand_share")
_FARTHEST_PLACE = 2**62


@dataclass(frozen=True, slots=True)
class WorldRecipe:
    """Ranges that each clip is drawn from; the defaults are those of an encoder's training (stage A).

    A range is a pair of its ends, both of which may be drawn; numbers in it are equally likely unless said otherwise.

    Attributes:
        environments: "town", or paths of scenario files or of folders of recordings with sweeps, of which each clip
            takes one. Paths are relative to the working directory. Of recordings, `frames` and `dt_s` alone are asked.
        first_place: seed of the first town: clips are in the towns of `first_place` to `first_place + places - 1`.
        places: number of towns.
        junctions: number of places where streets meet, of all towns; None: drawn for each, as are the next two.
        openness: openness of the view past corners, in [0, 1].
        lanes: most lanes a direction.
        plain_share: share of the clips without street furniture.
        street_share: share of the clips with the surroundings of real streets (`detail="street"`); `plain_share` is
            then one of the others.
        left_hand_share: share of the clips with traffic on the left: what is sensed there, seen in a mirror.
        realistic_share: share of the clips with sweeps as on real roads: see `coopsim.learn.clips.realism`.
        frames: frames of a clip.
        dt_s: times between two frames, of which each clip takes one.
        sweep_s: times of which each clip takes one: so long before each frame, a frame more, for networks on two
            sweeps; empty: none.
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
        cameras: names of camera rigs, with their weights: all agents of a clip carry the same; empty: none.
        camera_fov_deg: range of the cameras' horizontal opening angle. This and the next three are drawn for each
            camera of a rig.
        camera_turn_deg: range of the turn to the left from the rig's heading.
        camera_pitch_deg: range of the turn downwards from the pitch of the rig on a car, mast or drone.
        camera_above_m: range of the height over the agent's body.
        distorted_share: share of the clips whose lenses distort; the others are pinholes.
        times_of_day: names of lights in which cameras see, with their weights.
        sensors: ranges of sensors and ground of realistic clips that differ from the usual; None: none does.
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
    street_share: float = 0.0
    left_hand_share: float = 0.0
    realistic_share: float = 0.0
    frames: int = 6
    dt_s: Sequence[float] = (1.0,)
    sweep_s: Sequence[float] = ()
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
    cameras: Mapping[str, float] = field(default_factory=dict)
    camera_fov_deg: Sequence[float] = (90.0, 110.0)
    camera_turn_deg: Sequence[float] = (-10.0, 10.0)
    camera_pitch_deg: Sequence[float] = (-3.0, 3.0)
    camera_above_m: Sequence[float] = (0.05, 0.4)
    distorted_share: float = 0.2
    times_of_day: Mapping[str, float] = field(default_factory=lambda: {"day": 0.6, "dusk": 0.2, "night": 0.2})
    allow_test_places: bool = False
    sensors: SensorRanges | None = None

    def __post_init__(self) -> None:
        require_flag(allow_test_places=self.allow_test_places)
        require_count(1, frames=self.frames, places=self.places)
        require_count(0, _FARTHEST_PLACE - self.places, first_place=self.first_place)
        require_probability(**{name: getattr(self, name) for name in _SHARES})
        require_instance(SensorRanges, sensors=self.sensors)
        TownOptions(self.junctions, self.openness, self.lanes)  # its own checks
        environments = as_list("environments", self.environments)
        for name in environments:
            require_training_place(name, allowed=self.allow_test_places)
        times_s = as_list("dt_s", self.dt_s)
        for dt_s in times_s:
            require_frame_time(dt_s)
        for sweep_s in self.sweep_s:
            require_frame_time(sweep_s)
            if sweep_s > min(times_s) / 2:
                raise InvalidValueError(f"sweep_s must be at most half of every dt_s, got {sweep_s:g} s")
        changed: dict[str, Any] = {
            "environments": environments,
            "dt_s": tuple(map(float, times_s)),
            "sweep_s": tuple(map(float, self.sweep_s)),
            "lidars": as_lidar_weights(self.lidars, allowed=self.allow_test_places),
            "cameras": as_weights("cameras", "camera rigs", self.cameras, RIG_NAMES, least=0),
            "times_of_day": as_weights("times_of_day", "lights", self.times_of_day, DAYLIGHTS),
        }
        changed |= {name: as_count_range(name, getattr(self, name)) for name in _COUNTS}
        changed |= {name: as_range(name, getattr(self, name), *ends) for name, ends in _RANGES.items()}
        # Floats also where a file has 25 for 25.0: recipes that are equal are written alike.
        changed |= {name: float(getattr(self, name)) for name in _SHARES}
        for name, value in changed.items():
            object.__setattr__(self, name, value)
        if self.cameras and self.left_hand_share:
            raise InvalidValueError(
                f"left_hand_share must be 0 with cameras, got {self.left_hand_share:g}: images are not mirrored"
            )
        if not (self.cars[0] or self.masts[0]):
            raise InvalidValueError("cars or masts must be at least 1, so that every clip has an agent")

    def __repr__(self) -> str:
        """Return the fields, without those of `_LATER` that are unused: names of older recipes' clips stay the same."""
        shown = [each.name for each in fields(self) if each.name not in _LATER or self._has(each)]
        return f"WorldRecipe({', '.join(f'{name}={getattr(self, name)!r}' for name in shown)})"

    def _has(self, field: Field[Any]) -> bool:
        return bool(getattr(self, field.name) != field.default)

    @classmethod
    def for_validation(cls, **changed: Any) -> WorldRecipe:
        """Return the recipe of validation: towns 1000 to 1099, three cars, HDL-32E, dry air; with `changed` fields.

        With `cameras`, they are those of the named rigs.
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
            "camera_fov_deg": (100.0, 100.0),
            "camera_turn_deg": (0.0, 0.0),
            "camera_pitch_deg": (0.0, 0.0),
            "camera_above_m": (0.15, 0.15),
            "distorted_share": 0.0,
            "times_of_day": {"day": 1.0},
        }
        return cls(**{**usual, **changed})


_TEST_LIDARS = ("VLP-16", "OS1-128")


def require_training_place(name: object, *, allowed: bool) -> None:
    """Refuse an unknown environment, and a test place unless it is `allowed`.

    A file that is not shipped may still start from a test place, which is seen when it is read.
    """
    if not isinstance(name, str):
        raise InvalidValueError(f"environments must be names, or paths of scenario files or recordings, got {name!r}")
    if is_recordings_folder(name):
        return
    is_file = is_scenario_file(name)
    if not is_file:
        require_choice("environment", name, (TOWN, *SCENARIOS))
    is_own = is_file and Path(name).name not in scenario_files()
    if not (name == TOWN or is_own or allowed):
        raise InvalidValueError(
            f"environments must not be {name!r}, which is a test place: results are measured on the named scenarios "
            f"and the shipped files, so nothing is trained on them. Accepted: {TOWN!r}, scenario files of your own, or "
            "this one with allow_test_places: true"
        )


def as_lidar_weights(lidars: object, *, allowed: bool) -> dict[str, float]:
    """Return the weights of beam tables; test sensors are refused unless they are `allowed`."""
    weights = as_weights("lidars", "beam tables", lidars, PATTERNS)
    for name in weights:
        if name in _TEST_LIDARS and not allowed:
            raise InvalidValueError(
                f"lidars must not have {name!r}, which is a test sensor: results are measured on it untrained; it is "
                "accepted with allow_test_places: true"
            )
    return weights


def as_weights(option: str, what: str, given: object, known: Iterable[str], least: int = 1) -> dict[str, float]:
    """Return the weights of at least `least` known names, which errors call `what`."""
    if not isinstance(given, Mapping) or len(given) < least:
        raise InvalidValueError(f"{option} must be a mapping of {what} to weights, got {given!r}")
    for name, weight in given.items():
        require_choice(option, name, known)
        require_positive(**{f"the weight of {name}": weight})
    return {name: float(weight) for name, weight in given.items()}
