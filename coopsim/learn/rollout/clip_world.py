"""The world of one clip, drawn from a recipe."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.catalog import is_scenario_file, scenario_file_options, scenario_of_file
from coopsim.errors import InvalidValueError
from coopsim.learn.rollout.clip_cameras import draw_cameras
from coopsim.learn.rollout.recipe_draws import between, count_between, one_of
from coopsim.learn.rollout.world_recipe import WorldRecipe
from coopsim.sensors.camera.rigs import Rig
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.weather import Weather
from coopsim.support.rng import stream
from coopsim.world.population import drop_overridden
from coopsim.world.scenario import NUMBERS, Scenario
from coopsim.world.towns.scenario_choice import choose_scenarios
from coopsim.world.towns.town_scenarios import TOWN, TOWN_KEYS

_LONGEST_SEED = 2**62
_STEP_S = 0.1  # to which starts are rounded: traffic is stepped in tenths


@dataclass(frozen=True, slots=True)
class ClipWorld:
    """The world of a clip.

    Attributes:
        scenario: the place and its population.
        seed: of the episode.
        dt_s: time between two frames.
        start_s: time that traffic has run before the first one.
        lidar: of all agents.
        weather: rain and fog; None: dry and clear.
        cameras: of the agents of each kind; empty: none.
        time_of_day: name of the light in which they see.
    """

    scenario: Scenario
    seed: int
    dt_s: float
    start_s: float
    lidar: LidarConfig
    weather: Weather | None
    cameras: Mapping[str, Rig]
    time_of_day: str


def draw_world(recipe: WorldRecipe, seed: int, index: int) -> ClipWorld:
    """Draw the world of a clip: a function of the three arguments and of nothing else.

    Every quantity has a stream of its own, so a recipe with one range changed changes nothing else.

    Args:
        recipe: what to draw from.
        seed: of the training.
        index: of the clip, >= 0.
    """

    def rng(purpose: str) -> np.random.Generator:
        return stream(seed, purpose, "clip", str(index))

    environment = recipe.environments[int(rng("environment").integers(len(recipe.environments)))]
    place_seed = recipe.first_place + int(rng("place").integers(recipe.places))
    dt_s = float(recipe.dt_s[int(rng("dt_s").integers(len(recipe.dt_s)))])
    waited_s = between(recipe.start_s, rng("start"))
    pattern = one_of(recipe.lidars, rng("lidar"))
    noise_m = between(recipe.range_noise_m, rng("range noise"))
    return ClipWorld(
        scenario=_scenario(environment, place_seed, recipe, rng("population"), rng("agents"), rng("detail")),
        seed=int(rng("episode").integers(_LONGEST_SEED)),
        dt_s=dt_s,
        start_s=round(waited_s / _STEP_S) * _STEP_S,
        lidar=LidarConfig(pattern, range_noise_m=noise_m),
        weather=_weather(recipe, rng("weather")),
        cameras=draw_cameras(recipe, rng),
        time_of_day=one_of(recipe.times_of_day, rng("time of day")),
    )


def _scenario(
    environment: str,
    place_seed: int,
    recipe: WorldRecipe,
    people: np.random.Generator,
    agents: np.random.Generator,
    detail: np.random.Generator,
) -> Scenario:
    drawn: dict[str, Any] = {
        "density": between(recipe.density, people),
        "truck_share": between(recipe.truck_share, people),
        "buses": count_between(recipe.buses, people),
        "connected_cars": count_between(recipe.cars, agents),
        "rsus": count_between(recipe.masts, agents),
        "drones": count_between(recipe.drones, agents) if agents.random() < recipe.drone_share else 0,
        "detail": "plain" if detail.random() < recipe.plain_share else "full",
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
