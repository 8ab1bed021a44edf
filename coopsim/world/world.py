"""The simulated world: traffic, people and agents, stepped together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.checks import require_choice
from coopsim.support.rng import uniform_numbers
from coopsim.types import Ints, Mask
from coopsim.types.driving import CarState, Command
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model
from coopsim.world.models.paint import Colors, draw_colors
from coopsim.world.people.people import MANNERS, People, join_bodies
from coopsim.world.people.scripted import ScriptedPeople
from coopsim.world.places.layout import Cars
from coopsim.world.places.signals import lights_of
from coopsim.world.scenario import Scenario
from coopsim.world.script import Script
from coopsim.world.snapshot import Actors, AgentBody, RoadMap, RoadUsers, StaticPart
from coopsim.world.traffic.fleet import STEERED, Fleet
from coopsim.world.traffic.lights import red_ways
from coopsim.world.traffic.navigation import ROUTE_M
from coopsim.world.traffic.steered import DRY
from coopsim.world.traffic.traffic import Traffic

LONGEST_STEP_S = 0.1
"""Longest step of traffic: drivers that react once in half a second crash, because IDM and lane keeping are made for
tenths."""

PERSON_ID = 1_000_000_000
"""Ids of pedestrians start here, of children at twice as much and so on, of vehicles at 1: a kind's number does not
renumber another."""

STANDING = ("mast", "lamp", "barrier", "trunk")
"""Names of parts of places that a car does not pass, beside their furnishing, buildings and walls."""

BYSTANDER_ID = 100 * PERSON_ID
"""Ids of bystanders start here."""


class World:
    """The world of one episode.

    Attributes:
        conflict_ids: ids of the actors that a situation's script names as conflicting with the ego.

    Args:
        scenario: place and population.
        seed: decides everything that happens.
        control: driver of connected cars: "traffic", or the commands that are given to `step`: maneuvers ("policy"),
            accelerations ("acceleration" or "planner"), or accelerations and steering angles ("steering").
        traffic: engine of the vehicles, one of `coopsim.world.traffic.traffic.ENGINES`.
        driven: names of the connected cars that `control` is about; None: all.
        route_m: bounds of the distance along the lanes to the goal of a steered car, unless the scenario has its own.
        grip: coefficient of friction of steered cars' tyres.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        *,
        control: str = "traffic",
        traffic: str = "arrays",
        driven: Sequence[str] | None = None,
        route_m: tuple[float, float] = ROUTE_M,
        grip: float = DRY,
    ) -> None:
        layout, population = scenario.layout, scenario.population
        self._seed, self._drawn_key = seed, b"none yet"
        self._drawn: tuple[Colors, Colors, Floats]
        self.models: tuple[Model, ...] = scenario.models
        self._dirty = scenario.detail != "plain"
        self._sizes_m = np.array([model.size_m for model in self.models])
        self._labels = np.array([model.label for model in self.models])
        self._cycles_m = np.array([model.cycle_m for model in self.models])
        self.static: tuple[StaticPart, ...] = scenario.static
        self.map: RoadMap = scenario.road_map
        self._driven = control != "traffic"
        script = scenario.script
        count = population.connected if script is None else 1 + sum(role.connected for role in script.vehicles)
        for name in driven or ():
            require_choice("connected car in driven_agents", name, [f"cav_{number}" for number in range(count)])
        self._traffic = Traffic(
            layout,
            population,
            self.models,
            seed,
            control=control,
            engine=traffic,
            script=script,
            driven=None if driven is None else tuple(map(_number, driven)),
            route_m=scenario.route_m or route_m,
            grip=grip,
            furnishing=_standing(scenario),
        )
        self._signals, self._nodes = layout.signals, 0 if layout.footways is None else len(layout.footways.nodes)
        self._red: Mask | None = None
        self._states: tuple[str, ...] = ()
        self._show_lights()
        ways = dict.fromkeys(MANNERS, layout.footways)
        if layout.cycleways is not None:
            ways |= dict.fromkeys((ObjectClass.BICYCLE, ObjectClass.SCOOTER), layout.cycleways)
        self._walks = [ways[label] is layout.footways for label in MANNERS]
        taken = self._traffic.fleet.position
        self._people: list[People] = []
        for label in MANNERS:
            others = join_bodies(self._people)
            self._people.append(People(ways[label], population.people[label], label, self.models, seed, taken, others))
        self._scripted = ScriptedPeople(() if script is None else script.people, self.models, seed)
        groups: list[People | ScriptedPeople] = [*self._people, self._scripted]
        self._groups = {PERSON_ID * k: people for k, people in enumerate(groups, start=1) if len(people)}  # by first id
        self.conflict_ids: tuple[int, ...] = () if script is None else self._conflict_ids(script)
        self._time_s = 0.0
        self._layout, self._posts = layout, (population.rsus, population.drones)
        numbers = {model.name: k for k, model in enumerate(self.models)}
        resting = layout.bystanders if scenario.detail == "street" else ()
        self._resting_model = np.array([numbers[each.model] for each in resting], dtype=np.int64)
        self._resting = np.array([[each.x_m, each.y_m, each.heading_rad] for each in resting]).reshape(-1, 3)

    def step(self, dt_s: float, commands: Mapping[str, Command] | None = None) -> None:
        """Advance by `dt_s`, in equal parts short enough for drivers to react.

        Commands are maneuvers, accelerations in m/s², or these with steering angles in rad, by agent's name, where
        agents drive. They hold for the whole step, but a maneuver is carried out in its first part.
        """
        obeyed = (commands or {}) if self._driven else {}
        by_number = {_number(name): command for name, command in obeyed.items()}
        self._time_s += dt_s
        parts = max(1, math.ceil(dt_s / LONGEST_STEP_S - 1e-9))
        for part in range(parts):
            everybody = join_bodies((*self._people, self._scripted))
            held = {number: command for number, command in by_number.items() if not isinstance(command, int)}
            self._traffic.step(dt_s / parts, held if part else by_number, everybody)
            self._show_lights()
            for people, has_lights in zip(self._people, self._walks, strict=True):
                people.step(dt_s / parts, self._traffic.fleet, everybody, self._red if has_lights else None)
            self._scripted.step(dt_s / parts)

    def _show_lights(self) -> None:
        """Let people and the map know the traffic lights as they are now."""
        if self._traffic.light_states != self._states:
            self._states = self._traffic.light_states
            self._red = red_ways(self._signals, self._states, self._nodes)
            self.map = replace(self.map, lights=lights_of(self._signals, self._states))

    def _conflict_ids(self, script: Script) -> tuple[int, ...]:
        """Return the ids of the actors that the ego of a script may crash into."""
        vehicles = zip(self.fleet.rows["id"].tolist(), (script.ego, *script.vehicles), strict=False)
        people = enumerate(script.people, start=PERSON_ID * (len(MANNERS) + 1))
        return (*(k for k, role in vehicles if role.conflicts), *(k for k, role in people if role.conflicts))

    def road_users(self) -> RoadUsers:
        """Return where everybody is, in the order of `actors`, without what only pictures and sensors need."""
        fleet, groups, resting = self._traffic.fleet, self._groups.values(), self._resting
        model = np.concatenate([fleet.rows["model"], *(people.model for people in groups), self._resting_model])
        still = np.zeros((len(resting), 2))
        return RoadUsers(
            np.concatenate([fleet.position, *(people.position for people in groups), resting[:, :2]]),
            np.concatenate([fleet.rows["heading"], *(people.yaw for people in groups), resting[:, 2]]),
            np.concatenate([fleet.velocity, *(people.velocity for people in groups), still]),
            self._sizes_m[model],
            self._labels[model],
            model,
        )

    def actors(self) -> Actors:
        """Return all vehicles, connected ones included, then all people, then bystanders; in the world frame."""
        ground, yaw, velocity, size, label, model = self.road_users()
        fleet, groups, resting = self._traffic.fleet, self._groups, self._resting
        runs = [(first, len(each)) for first, each in groups.items()] + [(BYSTANDER_ID, len(resting))]
        identity = np.concatenate([fleet.rows["id"], *(first + np.arange(count) for first, count in runs)])
        middle = self._layout.on_ground(ground)
        middle[:, 2] += size[:, 2] / 2
        # Only people, on foot and riding, have cycles of poses.
        walked_m = [people.travelled_m for people in groups.values()]
        travelled_m = np.concatenate([np.zeros(len(fleet.rows)), *walked_m, np.zeros(len(resting))])
        color, accent, start = self._drawn_for(identity, label)
        return Actors.trusted(
            Boxes3D.trusted(middle, size, wrap_angle(yaw)),
            id=identity,
            velocity=velocity,
            label=label,
            model=model,
            color=color,
            accent=accent,
            phase=np.mod(travelled_m / self._cycles_m[model] + start, 1.0),
        )

    def _drawn_for(self, identity: Ints, label: Ints) -> tuple[Colors, Colors, Floats]:
        """Return first and second colours and phases of actors: each starts at a phase of its own."""
        key = identity.tobytes()
        if key != self._drawn_key:  # mostly the same actors as in the last frame
            start = uniform_numbers(self._seed, "phase", identity, 1)[:, 0]
            self._drawn_key, self._drawn = key, (*draw_colors(self._seed, identity, label, dirty=self._dirty), start)
        return self._drawn

    def agents(self) -> dict[str, AgentBody]:
        """Return connected cars, then roadside units, then drones."""
        rows = self._traffic.fleet.rows[list(self._traffic.connected)]
        place, height_m = np.column_stack([rows["x"], rows["y"]]), self._sizes_m[rows["model"], 2]
        return self._layout.agents(Cars(rows["id"], place, rows["heading"], height_m), self._posts, self._time_s)

    @property
    def fleet(self) -> Fleet:
        """All vehicles, moving ones first, as the traffic has them."""
        return self._traffic.fleet

    def car_ahead(self, name: str) -> CarState:
        """Return the motion of a connected car and the way ahead of it, as its driver knows them."""
        number = _number(name)
        rows, k = self.fleet.rows, self._traffic.connected[number]
        speed, acceleration, length, width = (
            float(rows[key][k]) for key in ("speed", "acceleration", "length", "width")
        )
        route, side = self._traffic.way_ahead(number), self.map.traffic_side
        red = int(rows["red_lights"][k])
        car = CarState(speed, acceleration, length, width, bool(rows["crashed"][k]), route, side, red_lights=red)
        if rows["driver"][k] != STEERED:
            return car
        wheel, wheelbase_m = float(rows["wheel"][k]), 2 * float(rows["axle_m"][k])
        return replace(car, steering_rad=wheel, wheelbase_m=wheelbase_m, wrong_way=bool(rows["against"][k]))

    def entries(self, name: str) -> Floats:
        """Return `Occlusions.entries` (A, 5) of a connected car, in its own frame; none of a car that nobody steers."""
        return self._traffic.entries(_number(name))

    def row_of(self, name: str) -> int:
        """Return the row of a connected car in `fleet` and in `road_users`."""
        return self._traffic.connected[_number(name)]

    def hit(self, name: str) -> str:
        """Return what a steered car has crashed into beside the road, "building" or "object"; "" for nothing."""
        return self._traffic.hit(_number(name))

    def release(self, name: str) -> None:
        """Hand a steered car to the traffic model, as one that has arrived."""
        self._traffic.release(_number(name))

    def crashed(self) -> tuple[int, ...]:
        """Return the ids of crashed vehicles, which stay where they are, as obstacles."""
        rows = self.fleet.rows
        return tuple(rows["id"][rows["crashed"]].tolist())

    def is_over_in(self, time_s: float) -> bool:
        """Return False: traffic goes on."""
        return False


def _standing(scenario: Scenario) -> list[StaticPart]:
    """Return the parts beside the road that a car does not pass."""
    furnishing = scenario.static[len(scenario.layout.static) :]
    return [*(part for part in scenario.layout.static if part.name in STANDING), *furnishing]


def _number(name: str) -> int:
    """Return the number of a connected car."""
    return int(name.removeprefix("cav_"))
