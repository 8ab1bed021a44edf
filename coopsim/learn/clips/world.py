"""The world of one clip, drawn from a recipe."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coopsim.catalog import is_scenario_file, scenario_file_options, scenario_of_file
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.realism import Realism, draw_realism, realistic_lidar
from coopsim.learn.clips.sensor_ranges import SensorRanges
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.sensors.camera.camera import Camera, Rig, rig
from coopsim.sensors.camera.intrinsics import Coefficients, Intrinsics, distort
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.weather import Weather
from coopsim.support.rng import stream
from coopsim.world.drawn_places import TOWN, TOWN_KEYS, choose_scenarios
from coopsim.world.population import drop_overridden
from coopsim.world.scenario import FURNISHINGS, NUMBERS, Scenario

_LONGEST_SEED = 2**62
_LEAST_ABOVE_M = 0.15  # of a LiDAR over a roof that is higher than the LiDAR was drawn to be
_STEP_S = 0.1  # to which starts are rounded: traffic is stepped in tenths


@dataclass(frozen=True, slots=True)
class ClipWorld:
    """The world of a clip.

    Attributes:
        scenario: place and population.
        seed: seed of the episode.
        dt_s: time between two frames.
        sweep_s: time between an earlier sweep and the frame that follows it; None: there are no earlier sweeps.
        start_s: time that traffic has run before the first one.
        lidar: LiDAR of every agent.
        weather: rain and fog; None: dry and clear.
        cameras: rig by kind of agent; empty: none.
        time_of_day: name of the light.
        realism: ground and sizes as on real roads; None: those of the town.
        is_left_hand: traffic is on the left; the world is that of its mirror, with traffic on the right.
        mount_m: height of cars' LiDARs over the ground; None: `lidar.above_m` over their roofs.
        sees_carrier: LiDARs see the car that carries them.
    """

    scenario: Scenario
    seed: int
    dt_s: float
    sweep_s: float | None
    start_s: float
    lidar: LidarConfig
    weather: Weather | None
    cameras: Mapping[str, Rig]
    time_of_day: str
    realism: Realism | None = None
    is_left_hand: bool = False
    mount_m: float | None = None
    sees_carrier: bool = False

    def under_lidar_m(self, kind: str, height_m: float) -> float:
        """Return the height of an agent's body, or of one that would carry its LiDAR where it was drawn."""
        if self.mount_m is None or kind != "cav":
            return height_m
        on_roof_m = height_m + min(self.lidar.above_m, _LEAST_ABOVE_M)
        return max(self.mount_m, on_roof_m) - self.lidar.above_m


def draw_world(recipe: WorldRecipe, seed: int, index: int) -> ClipWorld:
    """Draw the world of a clip: a function of the three arguments and of nothing else.

    Every quantity has a stream of its own, so a recipe with one range changed changes nothing else.
    """

    def rng(purpose: str) -> np.random.Generator:
        return stream(seed, purpose, "clip", str(index))

    environment = recipe.environments[int(rng("environment").integers(len(recipe.environments)))]
    place_seed = recipe.first_place + int(rng("place").integers(recipe.places))
    dt_s = float(recipe.dt_s[int(rng("dt_s").integers(len(recipe.dt_s)))])
    sweep_s = float(recipe.sweep_s[int(rng("sweep_s").integers(len(recipe.sweep_s)))]) if recipe.sweep_s else None
    waited_s = between(recipe.start_s, rng("start"))
    pattern = one_of(recipe.lidars, rng("lidar"))
    lidar = LidarConfig(pattern, range_noise_m=between(recipe.range_noise_m, rng("range noise")))
    is_real = rng("realistic").random() < recipe.realistic_share
    is_street = rng("street").random() < recipe.street_share
    detail = "street" if is_street else "plain" if rng("detail").random() < recipe.plain_share else "full"
    scenario = _scenario(environment, place_seed, recipe, rng("population"), rng("agents"), detail)
    realism, mount_m, sees_carrier = None, None, False
    if is_real:
        scenario = replace(scenario, layout=FURNISHINGS.get("clutter")(scenario.layout, rng("clutter")))
        ranges = recipe.sensors or SensorRanges()
        lidar = ranges.built(realistic_lidar(lidar, rng("lidar as built")), rng)
        realism = draw_realism(seed, index, ranges.draw("grade", rng), ranges.draw("roughness_m3", rng))
        mount_m, sees_carrier = ranges.draw("mount_m", rng), rng("sensor ego").random() < ranges.ego_share
    return ClipWorld(
        scenario=scenario,
        seed=int(rng("episode").integers(_LONGEST_SEED)),
        dt_s=dt_s,
        sweep_s=sweep_s,
        start_s=round(waited_s / _STEP_S) * _STEP_S,
        lidar=lidar,
        weather=_weather(recipe, rng("weather")),
        cameras=draw_cameras(recipe, rng),
        time_of_day=one_of(recipe.times_of_day, rng("time of day")),
        is_left_hand=bool(rng("left hand").random() < recipe.left_hand_share),
        realism=realism,
        mount_m=mount_m,
        sees_carrier=sees_carrier,
    )


def _scenario(
    environment: str,
    place_seed: int,
    recipe: WorldRecipe,
    people: np.random.Generator,
    agents: np.random.Generator,
    detail: str,
) -> Scenario:
    drawn: dict[str, Any] = {
        "density": between(recipe.density, people),
        "truck_share": between(recipe.truck_share, people),
        "buses": count_between(recipe.buses, people),
        "connected_cars": count_between(recipe.cars, agents),
        "rsus": count_between(recipe.masts, agents),
        "drones": count_between(recipe.drones, agents) if agents.random() < recipe.drone_share else 0,
        "detail": detail,
    }
    place: Any = environment
    if is_scenario_file(environment):
        place = scenario_of_file(environment)
        if isinstance(place, str) and place != TOWN and not recipe.allow_test_places:
            raise InvalidValueError(
                f"{environment} must have a place of its own, got the scenario {place!r}, which is a test place: "
                "results are measured there; it is accepted with allow_test_places: true"
            )
        known = {
            name: value for name, value in scenario_file_options(environment).items() if name in (*NUMBERS, *TOWN_KEYS)
        }
        drawn = {**drop_overridden(known, drawn), **drawn}
    if place == TOWN:
        wanted = {"junctions": recipe.junctions, "openness": recipe.openness, "lanes": recipe.lanes}
        drawn = {"place_seed": place_seed, **wanted, **drawn}
    if place == TOWN and drawn["place_seed"] is None:
        drawn["place_seed"] = place_seed
    return choose_scenarios(place, **drawn).of(place_seed)


def _weather(recipe: WorldRecipe, rng: np.random.Generator) -> Weather | None:
    rains, is_foggy, rate, far, wet = rng.random(5)
    rain_mm_h = recipe.rain_mm_h[0] + rate * (recipe.rain_mm_h[1] - recipe.rain_mm_h[0])
    nearest, farthest = (math.log(end) for end in recipe.fog_visibility_m)
    weather = Weather(
        rain_mm_h=rain_mm_h if rains < recipe.rain_share else 0.0,
        fog_visibility_m=math.exp(nearest + far * (farthest - nearest)) if is_foggy < recipe.fog_share else math.inf,
        wetness=wet if rains < recipe.rain_share else 0.0,
    )
    return weather if weather.has_clutter else None


_KINDS = ("cav", "rsu", "drone")
# Distortion of wide-angle lenses, from almost none to barrels whose straight lines are clearly bent. With k2 of at
# least 0.6 k1^2, the radius in the picture rises everywhere at a quarter of a pinhole's rate or more: no lens folds
# its picture over (it would below 0.45 k1^2).
_K1, _K2_MOST, _K2_LEAST_OF_K1_SQUARED, _P = (-0.25, -0.05), 0.05, 0.6, (-0.002, 0.002)


def draw_cameras(recipe: WorldRecipe, rng: Callable[[str], np.random.Generator]) -> dict[str, Rig]:
    """Draw the cameras of the agents of each kind, with the random stream of a purpose; none without `recipe.cameras`.

    All agents of a kind carry the same, and those of another kind the same with the pitch of their kind.
    """
    if not recipe.cameras:
        return {}
    name = one_of(recipe.cameras, rng("cameras"))
    distorts = rng("distortion").random() < recipe.distorted_share
    return {kind: tuple(_changed(camera, recipe, rng, distorts) for camera in rig(name, kind)) for kind in _KINDS}


def _changed(camera: Camera, recipe: WorldRecipe, rng: Callable[[str], np.random.Generator], distorts: bool) -> Camera:
    """Return a camera with drawn lens and mount; a stream of its own for each draw makes all kinds draw the same."""
    name = camera.name
    fov_rad = float(np.radians(between(recipe.camera_fov_deg, rng(f"opening of {name}"))))
    if distorts:
        coefficients = _distortion(rng(f"lens of {name}"))
        edge = distort(np.array([[np.tan(fov_rad / 2), 0.0]]), coefficients)[0, 0]
        # Of the pinhole whose picture reaches as far as this lens's: the camera sees as wide an angle as was drawn.
        lens = Intrinsics.from_fov(horizontal_fov_rad=2 * float(np.arctan(edge)), distortion=coefficients)
    else:
        lens = Intrinsics.from_fov(horizontal_fov_rad=fov_rad)
    return replace(
        camera,
        intrinsics=lens,
        yaw_rad=camera.yaw_rad + float(np.radians(between(recipe.camera_turn_deg, rng(f"turn of {name}")))),
        pitch_rad=camera.pitch_rad + float(np.radians(between(recipe.camera_pitch_deg, rng(f"pitch of {name}")))),
        above_m=between(recipe.camera_above_m, rng(f"height of {name}")),
    )


def _distortion(rng: np.random.Generator) -> Coefficients:
    k1 = between(_K1, rng)
    k2 = between((_K2_LEAST_OF_K1_SQUARED * k1**2, _K2_MOST), rng)
    return (k1, k2, between(_P, rng), between(_P, rng), 0.0)


def between(ends: Sequence[float], rng: np.random.Generator) -> float:
    """Draw a number of a range; all are equally likely."""
    return ends[0] + rng.random() * (ends[1] - ends[0])


def count_between(ends: Sequence[int], rng: np.random.Generator) -> int:
    """Draw an integer of a range, both ends among them."""
    return int(rng.integers(ends[0], ends[1] + 1))


def one_of(weights: Mapping[str, float], rng: np.random.Generator) -> str:
    """Draw a name, each as often as its weight says."""
    names = list(weights)
    shares = np.array([weights[name] for name in names], dtype=np.float64)
    return names[int(rng.choice(len(names), p=shares / shares.sum()))]
