"""All vehicles of an episode: their start, the company of connected cars, and replacements on the highway."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice
from coopsim.types.driving import Command, Route
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model
from coopsim.world.places.layout import Layout, StartSlot
from coopsim.world.places.road_network import LaneIndex
from coopsim.world.population import Population
from coopsim.world.script import Script
from coopsim.world.snapshot import StaticPart
from coopsim.world.traffic.array_engine import ArrayEngine
from coopsim.world.traffic.cut_out import CutOut
from coopsim.world.traffic.edges import Edges
from coopsim.world.traffic.fleet import (
    CHAUFFEURED,
    HIGHWAY,
    PARKED,
    PEDALLED,
    STEERED,
    TOWN,
    UNYIELDING,
    VEHICLE,
    Fleet,
)
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.lights import Lights
from coopsim.world.traffic.navigation import ROUTE_M, SteeredCars
from coopsim.world.traffic.obstacles import Kerbs, Obstacles
from coopsim.world.traffic.spawner import Spawner, slow_down_before_lines, slow_down_behind_others
from coopsim.world.traffic.steered import DRY

_COMPANY = 6
"""Cars that keep together, unless more of them are connected."""

_GAIN_1_S = 0.1  # haste per metre behind the company's middle
_HASTE_M_S = 4.0  # at most
_CLOSING_M_S = 9.0  # extra target speed in a convoy behind its first car
_SLOW, _FAST = (0.8, 0.95), (1.1, 1.3)  # shares of the cruising speed
_ENTRY_M = 30.0  # free road that a new vehicle needs ahead and behind, next to what it takes to adapt its speed
_EASY_BRAKING_M_S2 = 2.0

_SCRIPTED = {"unyielding": UNYIELDING, "steady": CHAUFFEURED, "leaves lane": CHAUFFEURED, "parked": PARKED}
"""Drivers by a role's manner. One whom nobody tells anything, as an agent might, keeps its speed."""

_DRIVERS = {"policy": CHAUFFEURED, "acceleration": PEDALLED, "planner": PEDALLED, "steering": STEERED}


class Engine(Protocol):
    """Moves a fleet."""

    @property
    def lights(self) -> Lights | None:
        """Traffic lights; None: the engine knows none."""

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, commands: Mapping[int, Command]) -> None:
        """Advance by `dt_s` among people (M,) `BODY`; `commands` are those of agents by row."""

    def way_ahead(self, fleet: Fleet, row: int) -> Route:
        """Return the way ahead of the vehicle in a row, in its own frame."""


def _highway_env(*place: Any) -> Engine:
    # Importing highway-env takes a second.
    from coopsim.world.traffic.highway_env_engine import ReferenceEngine

    return ReferenceEngine(*place)


ENGINES: dict[str, Callable[..., Engine]] = {
    "arrays": ArrayEngine,
    "highway-env": _highway_env,
}


class Traffic:
    """All vehicles of one episode.

    `control` is "traffic", which drives connected cars, or they obey the maneuvers ("policy"), the accelerations
    ("acceleration" or "planner") or the accelerations and steering ("steering") of agents; `engine` is one of
    `ENGINES`. Control is about the connected cars with the numbers in `driven`; None: all. With a `script`, its
    vehicles take the place of drawn ones on the roads: the ego in row 0, then the others in their order. Steered cars
    have goals at a distance within `route_m`, and tyres with the friction `grip`; meshes of `furnishing` stop them.

    Attributes:
        fleet: the vehicles, moving ones first, then parked ones.
        connected: rows of the connected cars, in the agents' order.
    """

    def __init__(
        self,
        layout: Layout,
        population: Population,
        models: Sequence[Model],
        seed: int,
        *,
        control: str = "traffic",
        engine: str = "arrays",
        script: Script | None = None,
        driven: Sequence[int] | None = None,
        route_m: tuple[float, float] = ROUTE_M,
        grip: float = DRY,
        furnishing: Sequence[StaticPart] = (),
    ) -> None:
        require_choice("traffic", engine, ENGINES)
        self._layout, self._models, self._furnishing = layout, models, furnishing
        self._network = NumberedNetwork(layout.network)
        self._spawner = Spawner(layout, self._network, models, seed)
        self._rng = self._spawner.rng
        self._engine = ENGINES[engine](
            self._network,
            layout.movements,
            layout.speeds_m_s,
            layout.priority,
            layout.clearance_m,
            layout.yields,
            layout.signals,
        )
        if layout.cut:
            require_choice("traffic in a place that is cut out of a map", engine, ["arrays"])
        self._edges = Edges(layout, self._network, seed) if layout.cut else None
        self._window_m = layout.window_m if script is None else None
        self._cut_out: CutOut | None = None
        self._company = np.zeros(0, dtype=np.int64)
        if script is not None:
            if engine != "arrays":
                raise InvalidValueError(f'traffic must be "arrays" where a scenario has a script, got {engine!r}')
            self._cast(script, population.parked, _DRIVERS.get(control), driven)
            self._steered = self._let_steer(seed, route_m, grip)
            return
        slots, labels = self._spawner.choose_starts(population)
        cars = self._cars(slots, labels)
        self.connected = tuple(cars[: population.connected])
        commanded = self._commanded(driven)
        # Not only the connected cars, unless a policy drives them: another connected car must not change the traffic.
        all_commanded = control != "traffic" and driven is None
        company = list(self.connected) if all_commanded else cars[: max(_COMPANY, len(self.connected))]
        if not self.connected or layout.cruise_m_s is None:
            company = []
        self._cruise_m_s = layout.cruise_m_s or 0.0
        count = len(slots) + population.parked
        roads_ahead = max([layout.roads_ahead, *(len(slot.route) for slot in layout.slots)])
        self.fleet = Fleet(np.zeros(count, VEHICLE), np.zeros((count, roads_ahead, 2), np.int64))
        usual_driver = TOWN if layout.window_m is None else HIGHWAY
        for k, (slot, label) in enumerate(zip(slots, labels, strict=True)):
            driver = _DRIVERS.get(control, usual_driver) if k in commanded else usual_driver
            if driver == HIGHWAY and k in company and layout.convoy_gap_s is not None:
                driver = TOWN  # which changes no lane
            speed = layout.cruise_m_s if k in company else None
            self._spawner.spawn(self.fleet, k, driver, layout.slots[slot], label, speed)
        if usual_driver == TOWN:  # on highways lanes are chosen by the vehicles in them
            slow_down_before_lines(self.fleet, len(slots), layout.road_map.stop_lines)
            slow_down_behind_others(self.fleet, len(slots))
        self._keep_in_cut()
        if layout.convoy_gap_s is not None:
            self.fleet.rows["time_wanted"][company] = layout.convoy_gap_s
        self._spawner.park(self.fleet, len(slots), population.parked)
        self._company = np.array([k for k in company if _goes_east(layout.slots[slots[k]].lane)], dtype=np.int64)
        self._steered = self._let_steer(seed, route_m, grip)

    def _let_steer(self, seed: int, route_m: tuple[float, float], grip: float) -> SteeredCars | None:
        """Return the cars that agents steer; None: there are none."""
        lights, layout = self._engine.lights, self._layout
        if lights is None or not (self.fleet.rows["driver"] == STEERED).any():
            return None
        places = layout.road_map
        obstacles = Obstacles([*places.buildings, *places.walls], self._furnishing, layout.heights)
        kerbs = None if layout.relief is None else partial(Kerbs, places.pavements, layout.heights)
        return SteeredCars(self.fleet, self._network.arrays, lights.movements, obstacles, kerbs, seed, route_m, grip)

    def hit(self, number: int) -> str:
        """Return the obstacle beside the road that a steered car has crashed into, by its number, "" for none."""
        return "" if self._steered is None else self._steered.hit(self.connected[number])

    def release(self, number: int) -> None:
        """Hand a steered car to the traffic model, by its number."""
        if self._steered is not None:
            driver = TOWN if self._layout.window_m is None else HIGHWAY
            self._steered.release(self.fleet, self.connected[number], driver)

    def _keep_in_cut(self) -> None:
        """Let connected cars stay in a place that is cut out of a map, and stop where a lane ends."""
        for name in ("stays", "ends"):
            self.fleet.rows[name][list(self.connected)] = self._layout.cut

    def _commanded(self, driven: Sequence[int] | None) -> tuple[int, ...]:
        """Return the rows of the connected cars with these numbers; None: of all."""
        return self.connected if driven is None else tuple(self.connected[number] for number in driven)

    def _cast(self, script: Script, parked: int, driver: int | None, driven: Sequence[int] | None) -> None:
        """Put the vehicles of a script on the roads, driven ones with a given driver, and parked ones beside."""
        roles = (script.ego, *script.vehicles)
        count = len(roles) + parked
        roads_ahead = max([self._layout.roads_ahead, *(len(role.route) for role in roles)])
        self.fleet = Fleet(np.zeros(count, VEHICLE), np.zeros((count, roads_ahead, 2), np.int64))
        self.connected = tuple(k for k, role in enumerate(roles) if role.connected or k == 0)
        commanded = self._commanded(driven)
        usual_driver = TOWN if self._layout.window_m is None else HIGHWAY
        for k, role in enumerate(roles):
            scripted = _SCRIPTED.get(role.manner, usual_driver)
            self._spawner.cast(self.fleet, k, driver if driver is not None and k in commanded else scripted, role)
        self._keep_in_cut()
        self._spawner.park(self.fleet, len(roles), parked)
        self._cut_out = CutOut(roles, self._network)

    def step(self, dt_s: float, commands: Mapping[int, Command], people: NDArray[Any]) -> None:
        """Advance by `dt_s` among people (M,) `BODY`; commands are those of agents, by the car's number."""
        self._keep_together()
        if self._cut_out is not None:
            self._cut_out.act(self.fleet)
        by_row = {self.connected[number]: command for number, command in commands.items()}
        if self._steered is not None:
            self._steered.find(self.fleet)
        self._engine.step(self.fleet, people, dt_s, by_row)
        if self._steered is not None:
            self._steered.judge(self.fleet.rows)
        if self._window_m is not None:
            self._renew(self._window_m)
        if self._edges is not None:
            self._come_in(self._edges)

    def way_ahead(self, number: int) -> Route:
        """Return the way ahead of a connected car, by its number."""
        row, lights = self.connected[number], self._engine.lights
        if self._steered is not None and lights is not None and self._steered.has(row):
            return self._steered.way_ahead(self.fleet, row, lights.movements)
        return self._engine.way_ahead(self.fleet, row)

    def entries(self, number: int) -> Floats:
        """Return places on lanes across the way of a connected car, by its number; see `Occlusions.entries`."""
        row, lights = self.connected[number], self._engine.lights
        if self._steered is None or lights is None or not self._steered.has(row):
            return np.zeros((0, 5))
        return self._steered.entries(self.fleet, row, lights.movements)

    @property
    def light_states(self) -> tuple[str, ...]:
        """Letters of the signals of the place, in their order."""
        return () if self._engine.lights is None else self._engine.lights.states

    def _come_in(self, edges: Edges) -> None:
        """Let vehicles that leave the place come in again as new ones; without room they stand, and block the exit."""
        rows = self.fleet.rows
        edges.hold(self.fleet, self.connected)
        for k in edges.leaving(self.fleet):
            found = None if rows["stays"][k] else edges.entry(self.fleet, self.connected)
            if found is None:
                rows["target_speed"][k] = 0.0
                continue
            slot, most_m_s = found
            lane = self._layout.network.get_lane(slot.lane)
            speed = min(self._rng.uniform(0.75, 1.0) * lane.speed_limit, most_m_s)
            label, driver = self._models[rows["model"][k]].label, int(rows["driver"][k])
            self._spawner.spawn(self.fleet, k, driver, slot, label, speed)
            rows["target_speed"][k] = max(speed, 0.75 * lane.speed_limit)

    def _cars(self, slots: list[int], labels: list[int]) -> list[int]:
        """Return the rows of cars in the order in which they become connected, which does not depend on the number."""
        place = {slot: k for k, slot in enumerate(slots)}
        order = [place[slot] for slot in self._layout.connected_order if slot in place]
        return [k for k in order if labels[k] == ObjectClass.CAR]

    def _keep_together(self) -> None:
        """Speed up cars behind the company's middle, slow down those ahead."""
        if not len(self._company):
            return
        rows, company = self.fleet.rows, self._company
        driving = company[~np.isin(rows["driver"][company], tuple(_DRIVERS.values())) & ~rows["crashed"][company]]
        if len(driving):
            along_m = rows["x"][driving]
            if self._layout.convoy_gap_s is None:
                haste_m_s = np.clip(_GAIN_1_S * (along_m.mean() - along_m), -_HASTE_M_S, _HASTE_M_S)
            else:  # all close up to the first
                haste_m_s = np.where(along_m == along_m.max(), 0.0, _CLOSING_M_S)
            rows["target_speed"][driving] = self._cruise_m_s + haste_m_s

    def _renew(self, window_m: float) -> None:
        """Replace vehicles far from all cars of the company by new ones at the window's edges."""
        rows = self.fleet.rows
        anchors = rows["x"][self._company] if len(self._company) else np.zeros(1)
        wrecked = rows["crashed"][self._company] if len(self._company) else np.ones(1, dtype=np.bool_)
        moving = not wrecked.all()
        edges = anchors[~wrecked] if moving else anchors  # a wreck keeps its surroundings, and is soon left behind
        low, high = float(edges.min()) - window_m, float(edges.max()) + window_m
        far = np.abs(anchors[:, None] - rows["x"]).min(axis=0) > window_m
        far[list(self.connected)] = False
        for k in np.flatnonzero(far).tolist():
            self._enter(k, low, high, moving=moving)

    def _enter(self, k: int, low: float, high: float, *, moving: bool) -> None:
        """Replace the vehicle in row `k` by a new one on its carriageway, in a lane with space; else it drives on.

        A window that moves east with the company is entered from behind by faster vehicles, in the passing lane if
        there is space, and from ahead by slower ones.
        """
        start, end, _ = gone = self._network.lane_index[self.fleet.rows["lane"][k]]
        lanes = self._rng.permutation(len(self._layout.network.graph[start][end]))
        eastward, speed = _goes_east(gone), None
        ahead = not eastward
        if eastward and moving:
            ahead = bool(self._rng.random() < 0.5)
            lanes = np.sort(lanes)[:: -1 if ahead else 1]
            speed = self._cruise_m_s * self._rng.uniform(*(_SLOW if ahead else _FAST))
        x = high - 5.0 if ahead else low + 5.0
        label = self._models[self.fleet.rows["model"][k]].label
        for number in lanes.tolist():
            index = (start, end, number)
            lane = self._layout.network.get_lane(index)
            if speed is None:
                speed = self._rng.uniform(0.75, 1.0) * lane.speed_limit
            if self._is_free(k, index, x, speed):
                along = lane.local_coordinates(np.array([x, lane.position(0.0, 0.0)[1]]))[0]
                self._spawner.spawn(self.fleet, k, HIGHWAY, StartSlot(index, float(along)), label, speed)
                return

    def _is_free(self, k: int, index: LaneIndex, x: float, speed: float) -> bool:
        """Return whether a vehicle that enters a lane (along x) forces no hard braking, its own included.

        Vehicles about to move into the lane count as in it.
        """
        rows, lane = self.fleet.rows, self._layout.network.get_lane(index)
        in_lane = np.abs(rows["y"] - lane.position(0.0, 0.0)[1]) < 3.0
        in_lane |= rows["target_lane"] == self._network.lane_number[index]
        in_lane[k] = False
        ahead_m = (rows["x"] - x) * exact.cos(lane.heading_at(0.0))
        closing_m_s = np.maximum(0.0, (speed - rows["speed"]) * np.sign(ahead_m))
        return not (in_lane & (np.abs(ahead_m) < _ENTRY_M + np.square(closing_m_s) / (2 * _EASY_BRAKING_M_S2))).any()


def _goes_east(lane: LaneIndex) -> bool:
    return lane[0].startswith("east")
