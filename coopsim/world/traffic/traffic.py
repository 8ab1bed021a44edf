"""All vehicles of an episode: their start, the company of connected cars, and replacements on the highway."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.support.checks import require_choice
from coopsim.support.rng import stream
from coopsim.types.driving import Command, Route
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import draw_models, models_of
from coopsim.world.models.model import Model
from coopsim.world.places.layout import LANE_M, Layout, StartSlot
from coopsim.world.places.road_network import LaneIndex, Road
from coopsim.world.population import Population
from coopsim.world.script import Script, VehicleRole
from coopsim.world.traffic.array_engine import ArrayEngine, closest_speed
from coopsim.world.traffic.cut_out import CutOut
from coopsim.world.traffic.fleet import CHAUFFEURED, HIGHWAY, PARKED, PEDALLED, TOWN, UNYIELDING, VEHICLE, Fleet
from coopsim.world.traffic.lanes import NumberedNetwork, closest_lane
from coopsim.world.traffic.rules import PARKED_ASIDE_M

_COMPANY = 6
"""Cars that keep together, unless more of them are connected."""

_GAIN_1_S = 0.1  # haste per metre behind the company's middle
_HASTE_M_S = 4.0  # at most
_CLOSING_M_S = 9.0  # extra target speed in a convoy behind its first car
_SLOW, _FAST = (0.8, 0.95), (1.1, 1.3)  # shares of the cruising speed
_ENTRY_M = 30.0  # free road that a new vehicle needs ahead and behind, next to what it takes to adapt its speed
_EASY_BRAKING_M_S2 = 2.0

_BRAKING_M_S2 = 5.0  # of a vehicle that starts right behind a slower one
_GAP_M = 0.5  # left when it has braked
_TURN_RAD = 0.3  # a vehicle with another heading is not ahead

_BUS_AXLES = 0.25  # from the middle, in lengths: half a length apart, as the models of buses have them

_PARKED_VANS = 0.15  # share of vans, where a bay has no class of its own

# Time gap (s) and lateral gain (1/s). highway-env's 1.5 s would fill the lanes of a highway, and leave no gap to pass;
# with its 1.67 a car turns by 15 degrees at 25 m/s, and back, in a second.
_MANNERS = {TOWN: (1.5, 1 / 0.6), HIGHWAY: (1.0, 0.5), CHAUFFEURED: (1.5, 1 / 0.6), PEDALLED: (1.5, 1 / 0.6)}
_MANNERS |= {UNYIELDING: _MANNERS[TOWN], PARKED: _MANNERS[TOWN]}


_SCRIPTED = {"unyielding": UNYIELDING, "steady": CHAUFFEURED, "leaves lane": CHAUFFEURED, "parked": PARKED}
"""Drivers by a role's manner. One whom nobody tells anything, as an agent might, keeps its speed."""

_DRIVERS = {"policy": CHAUFFEURED, "acceleration": PEDALLED, "planner": PEDALLED}


class Engine(Protocol):
    """Moves a fleet."""

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, commands: Mapping[int, Command]) -> None:
        """Advance by `dt_s` among people (M,) `BODY`; `commands` are those of agents by row."""

    def way_ahead(self, fleet: Fleet, row: int) -> Route:
        """Return the way ahead of the vehicle in a row, in its own frame."""


_Roads = Sequence[Road]


def _highway_env(
    network: NumberedNetwork, movements: _Roads, speeds_m_s: Sequence[float], priority: _Roads, clearance_m: float
) -> Engine:
    # Importing highway-env takes a second.
    from coopsim.world.traffic.highway_env_engine import ReferenceEngine

    return ReferenceEngine(network, movements, speeds_m_s, priority, clearance_m)


ENGINES: dict[str, Callable[[NumberedNetwork, _Roads, Sequence[float], _Roads, float], Engine]] = {
    "arrays": ArrayEngine,
    "highway-env": _highway_env,
}


class Spawner:
    """Makes the vehicles of an episode.

    Attributes:
        rng: draws of traffic.
    """

    def __init__(self, layout: Layout, network: NumberedNetwork, models: Sequence[Model], seed: int) -> None:
        self._layout, self._network, self._models, self._seed = layout, network, models, seed
        self.rng, self._turns_rng = stream(seed, "traffic"), stream(seed, "drivers")
        self._next_id = 1

    def choose_starts(self, population: Population) -> tuple[list[int], list[int]]:
        """Return the slots of the vehicles, ascending, and their classes.

        Good slots for connected cars are always taken, and get cars if the layout asks for it.
        """
        count = sum(population.on_roads.values())
        first = list(self._layout.connected_order[: count // 3])
        rest = self.rng.permutation(np.setdiff1d(np.arange(len(self._layout.slots)), first))
        slots = sorted([*first, *rest[: count - len(first)].tolist()])
        labels = self.rng.permutation([label for label, n in population.on_roads.items() for _ in range(n)]).tolist()
        return slots, self._with_cars_first(slots, labels)

    def _with_cars_first(self, slots: list[int], labels: list[int]) -> list[int]:
        """Reorder the classes so that the first `cars_first` slots have cars."""
        rank = {slot: place for place, slot in enumerate(self._layout.connected_order)}
        order = sorted(range(len(slots)), key=lambda k: rank.get(slots[k], len(rank)))
        cars = [k for k in order if labels[k] == ObjectClass.CAR][: self._layout.cars_first]
        donors = cars + [k for k in order if k not in cars]
        given = dict(zip(order, (labels[k] for k in donors), strict=True))
        return [given[k] for k in range(len(labels))]

    def spawn(self, fleet: Fleet, k: int, driver: int, slot: StartSlot, label: int, speed: float | None = None) -> None:
        """Put a new vehicle into row `k`; without a speed (m/s) it is near the lane's limit."""
        lane = self._layout.network.get_lane(slot.lane)
        along = slot.along_m + self.rng.uniform(-1.0, 1.0)
        if speed is None:
            speed = self.rng.uniform(0.75, 1.0) * lane.speed_limit
        fitting = models_of(self._models, ObjectClass(label))
        (model,) = draw_models(self.rng, self._models, fitting, 1).tolist()
        start = StartSlot(slot.lane, along, slot.route)
        row = self._put(fleet, k, driver, start, model, int(self._turns_rng.integers(2**63)))
        row["speed"] = row["target_speed"] = speed
        if driver == CHAUFFEURED:
            speeds = np.array(self._layout.speeds_m_s)
            row["target_speed"] = speeds[closest_speed(speeds, speed)]

    def cast(self, fleet: Fleet, k: int, driver: int, role: VehicleRole) -> None:
        """Put a vehicle of a script into row `k`; a driver who starts from a stand wants the lane's limit."""
        rng = stream(self._seed, "script", str(k))
        fitting = models_of(self._models, role.label, parked=role.manner == "parked")
        if role.model is not None:
            require_choice(f"model of {role.name!r}", role.model, [self._models[number].name for number in fitting])
            fitting = np.array([number for number in fitting if self._models[number].name == role.model])
        (model,) = draw_models(rng, self._models, fitting, 1).tolist()
        start = StartSlot(role.lane, role.along_m, role.route)
        row = self._put(fleet, k, driver, start, model, int(rng.integers(2**63)))
        lane = self._layout.network.get_lane(role.lane)
        row["x"], row["y"] = lane.position(role.along_m, role.aside_m)
        row["speed"] = row["target_speed"] = role.speed_m_s
        if not role.speed_m_s and driver != CHAUFFEURED:
            row["target_speed"] = lane.speed_limit

    def _put(self, fleet: Fleet, k: int, driver: int, start: StartSlot, model: int, turn_key: int) -> Any:
        """Put a standing vehicle into row `k`, which is returned."""
        lane, row = self._layout.network.get_lane(start.lane), fleet.rows[k]
        fleet.rows[k] = np.zeros((), VEHICLE)
        row["id"], row["driver"], row["model"] = self._new_id(), driver, model
        row["x"], row["y"] = lane.position(start.along_m, 0.0)
        row["heading"] = lane.heading_at(start.along_m)
        row["length"], row["width"] = self._models[model].size_m[:2]
        row["axle_m"] = row["length"] * (_BUS_AXLES if self._models[model].label == ObjectClass.BUS else 0.5)
        row["lane"] = row["target_lane"] = self._network.lane_number[start.lane]
        row["time_wanted"], row["lateral_gain"] = _MANNERS[driver]
        row["timer"] = (row["x"] + row["y"]) * np.pi % 1.0  # as in highway-env: not all change lanes at once
        row["turn_key"] = turn_key
        row["movement"] = row["ticket"] = -1
        row["route_length"] = len(start.route)
        for place, road in enumerate(start.route):
            fleet.routes[k, place] = self._network.road_number[road], -1
        return row

    def park(self, fleet: Fleet, first: int, count: int) -> None:
        """Park vehicles in the rows from `first` on: in bays that have a class of their own, then in any."""
        rng, bays = stream(self._seed, "parking"), self._layout.bays
        chosen = sorted(rng.permutation(len(bays)).tolist(), key=lambda k: bays[k].label is None)[:count]
        for k, bay in enumerate((bays[number] for number in sorted(chosen)), start=first):
            drawn = ObjectClass.VAN if rng.random() < _PARKED_VANS else ObjectClass.CAR
            fitting = models_of(self._models, drawn if bay.label is None else bay.label, parked=True)
            row = fleet.rows[k]
            row["id"], row["driver"] = self._new_id(), PARKED
            (row["model"],) = draw_models(rng, self._models, fitting, 1)
            row["x"] = bay.x_m + rng.uniform(-PARKED_ASIDE_M, PARKED_ASIDE_M)
            row["y"], row["heading"] = bay.y_m, bay.heading_rad
            row["length"], row["width"] = self._models[row["model"]].size_m[:2]
            row["axle_m"] = row["length"] / 2
            lane = closest_lane(self._network.arrays.lanes, bay.x_m, bay.y_m, bay.heading_rad, 0)
            row["lane"] = row["target_lane"] = lane
            row["movement"] = row["ticket"] = -1

    def _new_id(self) -> int:
        self._next_id += 1
        return self._next_id - 1


def slow_down_behind_others(fleet: Fleet, count: int) -> None:
    """Limit the speeds of the first `count` vehicles so that each can stop behind the one right ahead.

    Two buses in neighbouring slots are less than a metre apart.
    """
    rows = fleet.rows[:count]
    direction = np.column_stack([exact.cos(rows["heading"]), exact.sin(rows["heading"])])
    offset = fleet.position[:count] - fleet.position[:count, None]  # (from, to)
    ahead_m = exact.dot(offset, direction[:, None])
    aside_m = np.abs(offset[..., 0] * direction[:, None, 1] - offset[..., 1] * direction[:, None, 0])
    leads = (ahead_m > 0) & (aside_m < LANE_M / 2) & (exact.dot(direction[:, None], direction) > exact.cos(_TURN_RAD))
    gap_m = ahead_m - (rows["length"] + rows["length"][:, None]) / 2 - _GAP_M
    braked = np.where(leads, 2 * _BRAKING_M_S2 * np.maximum(gap_m, 0.0), np.inf)
    for _ in range(count):  # a vehicle slowed down for one ahead may be too slow for one behind
        slower = np.minimum(rows["speed"], np.sqrt((np.square(rows["speed"]) + braked).min(axis=1, initial=np.inf)))
        if (slower == rows["speed"]).all():
            break
        rows["speed"] = slower


class Traffic:
    """All vehicles of one episode.

    `control` is "traffic", which drives connected cars, or they obey the maneuvers ("policy") or the accelerations
    ("acceleration" or "planner") of agents; `engine` is one of `ENGINES`. Control is about the connected cars with the
    numbers in `driven`; None: all. With a `script`, its vehicles take the place of drawn ones on the roads: the ego in
    row 0, then the others in their order.

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
    ) -> None:
        require_choice("traffic", engine, ENGINES)
        self._layout, self._models = layout, models
        self._network = NumberedNetwork(layout.network)
        self._spawner = Spawner(layout, self._network, models, seed)
        self._rng = self._spawner.rng
        self._engine = ENGINES[engine](
            self._network, layout.movements, layout.speeds_m_s, layout.priority, layout.clearance_m
        )
        self._window_m = layout.window_m if script is None else None
        self._cut_out: CutOut | None = None
        self._company = np.zeros(0, dtype=np.int64)
        if script is not None:
            if engine != "arrays":
                raise InvalidValueError(f'traffic must be "arrays" where a scenario has a script, got {engine!r}')
            self._cast(script, population.parked, _DRIVERS.get(control), driven)
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
            slow_down_behind_others(self.fleet, len(slots))
        if layout.convoy_gap_s is not None:
            self.fleet.rows["time_wanted"][company] = layout.convoy_gap_s
        self._spawner.park(self.fleet, len(slots), population.parked)
        self._company = np.array([k for k in company if _goes_east(layout.slots[slots[k]].lane)], dtype=np.int64)

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
        self._spawner.park(self.fleet, len(roles), parked)
        self._cut_out = CutOut(roles, self._network)

    def step(self, dt_s: float, commands: Mapping[int, Command], people: NDArray[Any]) -> None:
        """Advance by `dt_s` among people (M,) `BODY`; commands are those of agents, by the car's number."""
        self._keep_together()
        if self._cut_out is not None:
            self._cut_out.act(self.fleet)
        by_row = {self.connected[number]: command for number, command in commands.items()}
        self._engine.step(self.fleet, people, dt_s, by_row)
        if self._window_m is not None:
            self._renew(self._window_m)

    def way_ahead(self, number: int) -> Route:
        """Return the way ahead of a connected car, by its number."""
        return self._engine.way_ahead(self.fleet, self.connected[number])

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
