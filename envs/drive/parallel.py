"""`coopsim/drive-v1` for several cars: PettingZoo's parallel API straight around a world."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from coopsim.envs.drive.observation import NUMBERS, Observed, observe
from coopsim.envs.drive.outcome import Judge, Outcome
from coopsim.envs.drive.reward import RouteReward
from coopsim.envs.options import sort_options
from coopsim.envs.rewards import DriveStep, total
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import EpisodeStateError, InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import FrameCounts
from coopsim.support.checks import require_count, require_frame_time, require_instance, require_positive
from coopsim.support.rng import fresh_seed, require_seed
from coopsim.types import seconds_to_ns
from coopsim.types.driving import STEERING, CarState
from coopsim.viz.bev import BevFrame, BevRenderer
from coopsim.wire.actions import checked_numbers, command_space, require_agents
from coopsim.world.drawn_places import choose_scenarios, find_drawer
from coopsim.world.population import Population
from coopsim.world.scenario import Place
from coopsim.world.snapshot import RoadUsers
from coopsim.world.world import World

Infos = dict[str, dict[str, Any]]
Stepped = tuple[dict[str, Observed], dict[str, float], dict[str, bool], dict[str, bool], Infos]

ROUTE_M = (200.0, 1000.0)
"""Bounds of the distance to a goal, unless others are asked for."""

_DELAY_S = 5.0  # of the CARLA leaderboard's time for a route
_NOTHING = FrameCounts(0, 0, 0, 0, 0)  # nobody reports tracks
_BRAKES = (-8.0, 0.0)


@dataclass(slots=True)
class _Trip:
    """The drive of one car: its state, and the steps that it may take."""

    car: CarState
    steps: int
    taken: int = 0

    @property
    def left(self) -> float:
        return max(1.0 - self.taken / self.steps, 0.0)


class DriveParallel(ParallelEnv[str, Observed, Observed]):  # type: ignore[misc]  # pettingzoo is untyped
    """Cars that are steered along routes of their own through traffic, without sensors and messages.

    An action is a (2,) `Box`: acceleration in m/s², from -8 to 3, and angle of the front wheels in rad, from -0.6 to
    0.6, positive to the left. Observations are described in `coopsim.envs.drive.observation`, infos in
    `coopsim.envs.drive.outcome`, rewards in `coopsim.envs.drive.reward`.

    A car's drive terminates when it crashes, leaves the road or its route, or arrives, and is truncated when its time
    is over: the CARLA leaderboard's 0.8 s a metre, and 5 s. Then the car is no agent any more. One that has arrived
    drives on with the traffic, others brake and stay.

    Args:
        place: name of the place, "town" for one drawn by each seed, or path of a file of places, such as a map.
        cars: number of cars that are steered.
        route_m: bounds of the distance to a goal along the lanes.
        reward: weights of the reward; None: the usual ones.
        dt_s: time between two steps.
        seconds_per_m: time for a metre of the route.
        weather: a `Weather`, its mapping or its name: wet roads are slippery.
        grip: coefficient of friction of the tyres; None: by the weather.
        density: factor on the numbers of vehicles and people.
        render_mode: "rgb_array", "human" or None.
        **options: fields of `Population`, and for drawn places those of `DrawnPlaces.kinds`.

    Raises:
        UnknownNameError, InvalidValueError: an option is not accepted.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # PettingZoo reads it of the class
        "name": "coopsim/drive-v1",
        "render_modes": ["rgb_array", "human"],
        "is_parallelizable": True,
        "render_fps": 10,
    }

    def __init__(
        self,
        place: str | Path | Place = "town",
        *,
        cars: int = 1,
        route_m: tuple[float, float] = ROUTE_M,
        reward: RouteReward | None = None,
        dt_s: float = 0.1,
        seconds_per_m: float = 0.8,
        weather: Any = None,
        grip: float | None = None,
        density: float = 1.0,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        require_count(1, cars=cars)
        require_frame_time(dt_s)
        require_positive(seconds_per_m=seconds_per_m)
        require_instance(RouteReward, reward=reward)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidValueError(f'render_mode must be "rgb_array", "human" or None, got {render_mode!r}')
        place = str(place) if isinstance(place, Path) else place
        drawer = find_drawer(place)
        sort_options(options, Population, *(() if drawer is None else drawer.kinds), also_accepted=_OWN)
        given = {"connected_cars": cars} | options
        self._scenarios = choose_scenarios(place, density=density, **given)
        # Checked there: they are options of every simulation.
        sensed = SimulationOptions(control="steering", route_m=route_m, weather=weather, grip=grip, lidar=None)
        self._route_m, self._grip = sensed.route_m, sensed.chosen_grip
        self._reward, self._dt_s, self._seconds_per_m = reward or RouteReward(), dt_s, seconds_per_m
        self.possible_agents = [f"cav_{number}" for number in range(cars)]
        self.agents: list[str] = []
        self.render_mode = render_mode
        self.metadata = type(self).metadata | {"render_fps": max(1, round(1 / dt_s))}
        self._observed = {name: spaces.Box(-1.0, 1.0, (NUMBERS,), np.float32) for name in self.possible_agents}
        self._acted = {name: command_space(STEERING) for name in self.possible_agents}
        self._world: World
        self._trips: dict[str, _Trip] = {}
        self._renderer: BevRenderer | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's observations; always the same object."""
        return self._observed[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions; always the same object."""
        return self._acted[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observed], Infos]:
        """Begin an episode; return observations and infos by agent; `seed` decides everything, None is a fresh one."""
        seed = fresh_seed() if seed is None else seed
        require_seed(seed)
        scenario = self._scenarios.of(seed)
        names = self.possible_agents
        self._world = World(scenario, seed, control="steering", driven=names, route_m=self._route_m, grip=self._grip)
        self._judge, self.agents, self._step = Judge(self._world.map), list(names), 0
        cars = {name: self._world.car_ahead(name) for name in names}
        self._trips = {name: _Trip(car, self._steps_for(car.route.length_m)) for name, car in cars.items()}
        self._users = self._world.road_users()
        drawn = {} if scenario.place_seed is None else {"place_seed": scenario.place_seed}
        infos = {name: {"seed": seed, **drawn, **self._outcome(name, cars[name]).infos} for name in names}
        self._show_if_human()
        return {name: self._observe(name) for name in names}, infos

    def step(self, actions: Mapping[str, Any]) -> Stepped:
        """Drive for a step.

        Args:
            actions: one for every agent in `agents`.

        Raises:
            EpisodeStateError: before `reset`, or after the last drive's end.
            InvalidActionError: says what is wrong. The environment is as it was before.
        """
        names = self._running(actions)
        commands = dict.fromkeys(self.possible_agents, _BRAKES)
        for name in names:
            command = checked_numbers(name, STEERING, actions[name])
            assert isinstance(command, tuple)
            commands[name] = command
        before, self._step = self._users, self._step + 1
        self._world.step(self._dt_s, commands)
        self._users = self._world.road_users()
        seen, rewards, infos = dict[str, Observed](), dict[str, float](), Infos()
        terminated, truncated = dict[str, bool](), dict[str, bool]()
        for name in names:
            trip, was = self._trips[name], self._trips[name].car
            trip.car, trip.taken = self._world.car_ahead(name), trip.taken + 1
            outcome = self._outcome(name, was)
            moved_m = _moved(before, self._users, self._world.row_of(name))
            parts = self._reward.parts(DriveStep(_NOTHING, self._dt_s, was, trip.car, moved_m))
            parts |= self._reward.events(
                arrives=outcome.arrives, leaves=outcome.leaves, red_light=outcome.infos["red_light"]
            )
            seen[name], rewards[name] = self._observe(name), total(parts)
            terminated[name], infos[name] = outcome.terminated, {**outcome.infos, "reward_parts": parts}
            truncated[name] = not outcome.terminated and trip.taken >= trip.steps
            if outcome.arrives:
                self._world.release(name)
        self.agents = [name for name in names if not (terminated[name] or truncated[name])]
        self._show_if_human()
        return seen, rewards, terminated, truncated, infos

    @property
    def dt_s(self) -> float:
        """Time between two steps."""
        return self._dt_s

    @property
    def world(self) -> World:
        """The world of the running episode."""
        return self._world

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the world from above, around the first car: (H, W, 3) for "rgb_array", a window for "human"."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = BevRenderer(self._world.map)
        self._renderer.show_map(self._world.map)
        ego = (self.agents or self.possible_agents)[0]
        time_ns = seconds_to_ns(self._step * self._dt_s)
        frame = BevFrame(time_ns, self._world.actors(), self._world.agents(), np.zeros((0, 3)), {}, (), ego)
        return self._renderer.render(frame, self.render_mode)

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _steps_for(self, length_m: float) -> int:
        return math.ceil((length_m * self._seconds_per_m + _DELAY_S) / self._dt_s)

    def _running(self, actions: object) -> list[str]:
        if not self.agents:
            raise EpisodeStateError("there is no running drive: call reset to begin an episode")
        require_agents(actions, self.agents)
        return list(self.agents)

    def _observe(self, name: str) -> Observed:
        trip = self._trips[name]
        return observe(trip.car, self._world.row_of(name), self._users, trip.left)

    def _outcome(self, name: str, was: CarState) -> Outcome:
        trip, row, hit = self._trips[name], self._world.row_of(name), self._world.hit(name)
        return self._judge.outcome(was, trip.car, row, self._users, hit, timed_out=trip.taken >= trip.steps)

    def _show_if_human(self) -> None:
        if self.render_mode == "human":
            self.render()


_OWN = ("place", "cars", "route_m", "reward", "dt_s", "seconds_per_m", "weather", "grip", "density", "render_mode")


def _moved(before: RoadUsers, after: RoadUsers, row: int) -> Floats:
    """Return where a road user is (2,) m after a step, in its own frame before it."""
    x, y = (after.position[row] - before.position[row]).tolist()
    cos, sin = math.cos(before.yaw[row]), math.sin(before.yaw[row])
    return np.array([x * cos + y * sin, y * cos - x * sin])
