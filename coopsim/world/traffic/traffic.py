"""All vehicles of an episode: who starts where, who keeps whom company, and who replaces whom."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.support.checks import require_choice
from coopsim.support.rng import stream
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model, models_of
from coopsim.world.places.layout import LANE_M, LaneIndex, Layout, Slot
from coopsim.world.population import Population
from coopsim.world.traffic.engine.array_engine import ArrayEngine, closest_speed
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, HIGHWAY, PARKED, TOWN, VEHICLE, Fleet
from coopsim.world.traffic.engine.lanes import Network
from coopsim.world.traffic.highway_reference.reference_engine import ReferenceEngine

_COMPANY = 6
"""Cars that keep together, unless more of them are connected."""

_GAIN_1_S = 0.1  # how much faster per metre behind the others
_HASTE_M_S = 4.0  # at most
_CLOSING_M_S = 9.0  # how much faster than its first car those of a convoy would like to go
_SLOW, _FAST = (0.8, 0.95), (1.1, 1.3)  # shares of the cruising speed
_ENTRY_M = 30.0  # free road that a new vehicle needs ahead and behind, next to what it takes to adapt its speed
_EASY_BRAKING_M_S2 = 2.0
_START_BRAKING_M_S2 = 5.0  # of who starts right behind somebody slower
_START_GAP_M = 0.5  # left when it has braked
_START_TURN_RAD = 0.3  # who goes another way is not ahead

_BUS_AXLES = 0.25  # from the middle, in lengths: between them is half of it, as `coopsim.world.models.heavy` draws them

PARKED_ASIDE_M = 0.15
"""How far from the middle of its bay somebody stands, at most."""

_PARKED_VANS = 0.15  # share of them, where a bay has no class of its own

# Time gap (s) and lateral gain (1/s). highway-env's 1.5 s would fill the lanes of a highway, and nobody could pass;
# with its 1.67 a car turns by 15 degrees at 25 m/s, and back, in a second.
_MANNERS = {TOWN: (1.5, 1 / 0.6), HIGHWAY: (1.0, 0.5), CHAUFFEURED: (1.5, 1 / 0.6)}


class Engine(Protocol):
    """What moves a fleet."""

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, told: Mapping[int, int]) -> None:
        """Advance by `dt_s` among people (M,) `BODY`; `told` are numbers into `MANEUVERS` by row."""


_Roads = Sequence[tuple[str, str]]

ENGINES: dict[str, Callable[[Network, _Roads, Sequence[float], _Roads, float], Engine]] = {
    "arrays": ArrayEngine,
    "highway-env": ReferenceEngine,
}


class Traffic:
    """All vehicles of one episode.

    Args:
        layout: the place.
        population: how many.
        models: shapes to choose from.
        seed: the episode's.
        policy_control: connected cars do as they are told.
        engine: name of what steps them, one of `ENGINES`.
    """

    def __init__(
        self,
        layout: Layout,
        population: Population,
        models: Sequence[Model],
        seed: int,
        *,
        policy_control: bool = False,
        engine: str = "arrays",
    ) -> None:
        require_choice("traffic", engine, ENGINES)
        self._layout, self._models = layout, models
        self._rng, self._turns_rng = stream(seed, "traffic"), stream(seed, "drivers")
        self._network = Network(layout.network)
        self._engine = ENGINES[engine](
            self._network, layout.movements, layout.speeds_m_s, layout.priority, layout.clearance_m
        )
        self._usual_driver = TOWN if layout.window_m is None else HIGHWAY
        self._next_id = 1
        slots = self._choose_slots(population)
        labels = self._rng.permutation([label for label, n in population.on_roads.items() for _ in range(n)]).tolist()
        labels = self._with_cars_first(slots, labels)
        cars = self._cars(slots, labels)
        self.connected = tuple(cars[: population.connected])
        # Not the connected cars alone, unless a policy drives them: one more of them shall not change the traffic.
        company = list(self.connected) if policy_control else cars[: max(_COMPANY, len(self.connected))]
        if not self.connected or layout.cruise_m_s is None:
            company = []
        self._cruise_m_s = layout.cruise_m_s or 0.0
        count = len(slots) + population.parked
        roads_ahead = max([layout.roads_ahead, *(len(slot.route) for slot in layout.slots)])
        self.fleet = Fleet(np.zeros(count, VEHICLE), np.zeros((count, roads_ahead, 2), np.int64))
        for k, (slot, label) in enumerate(zip(slots, labels, strict=True)):
            driver = CHAUFFEURED if policy_control and k in self.connected else self._usual_driver
            if driver == HIGHWAY and k in company and layout.convoy_gap_s is not None:
                driver = TOWN  # who changes no lane
            self._spawn(k, driver, layout.slots[slot], label, layout.cruise_m_s if k in company else None)
        if self._usual_driver == TOWN:  # on highways lanes are chosen by who is in them
            self._start_behind_others(len(slots))
        if layout.convoy_gap_s is not None:
            self.fleet.rows["time_wanted"][company] = layout.convoy_gap_s
        self._park(len(slots), population.parked, seed)
        self._company = np.array([k for k in company if _goes_east(layout.slots[slots[k]].lane)], dtype=np.int64)

    def step(self, dt_s: float, maneuvers: Mapping[int, int], people: NDArray[Any]) -> None:
        """Advance by `dt_s`.

        Args:
            dt_s: time step.
            maneuvers: numbers into `coopsim.types.maneuvers.MANEUVERS` by the number of the connected car.
            people: (M,) `coopsim.world.traffic.engine.fleet.BODY`, whom vehicles see.
        """
        self._keep_together()
        told = {self.connected[number]: maneuver for number, maneuver in maneuvers.items()}
        self._engine.step(self.fleet, people, dt_s, told)
        if self._layout.window_m is not None:
            self._renew(self._layout.window_m)

    def _choose_slots(self, population: Population) -> list[int]:
        """Slots of the vehicles, in the layout's order; those that make good connected cars are always taken."""
        count = sum(population.on_roads.values())
        first = list(self._layout.connected_first[: count // 3])
        rest = self._rng.permutation(np.setdiff1d(np.arange(len(self._layout.slots)), first))
        return sorted([*first, *rest[: count - len(first)].tolist()])

    def _cars(self, slots: list[int], labels: list[int]) -> list[int]:
        """Which vehicles are cars, in the order in which they become connected: one more changes no other."""
        place = {slot: k for k, slot in enumerate(slots)}
        order = [place[slot] for slot in self._layout.connected_first if slot in place]
        return [k for k in order if labels[k] == ObjectClass.CAR]

    def _with_cars_first(self, slots: list[int], labels: list[int]) -> list[int]:
        """The same classes in another order: as many of the first slots as the layout asks for have cars."""
        rank = {slot: place for place, slot in enumerate(self._layout.connected_first)}
        order = sorted(range(len(slots)), key=lambda k: rank.get(slots[k], len(rank)))
        cars = [k for k in order if labels[k] == ObjectClass.CAR][: self._layout.cars_first]
        donors = cars + [k for k in order if k not in cars]
        given = dict(zip(order, (labels[k] for k in donors), strict=True))
        return [given[k] for k in range(len(labels))]

    def _spawn(self, k: int, driver: int, slot: Slot, label: int, speed: float | None = None) -> None:
        """Put a new vehicle into row `k`."""
        lane = self._layout.network.get_lane(slot.lane)
        along = slot.along_m + self._rng.uniform(-1.0, 1.0)
        if speed is None:
            speed = self._rng.uniform(0.75, 1.0) * lane.speed_limit
        fitting = models_of(self._models, ObjectClass(label))
        model = fitting[self._rng.integers(len(fitting))]
        self.fleet.rows[k] = np.zeros((), VEHICLE)
        row = self.fleet.rows[k]
        row["id"], row["driver"], row["model"] = self._next_id, driver, model
        self._next_id += 1
        row["x"], row["y"] = lane.position(along, 0.0)
        row["heading"], row["speed"], row["target_speed"] = lane.heading_at(along), speed, speed
        if driver == CHAUFFEURED:
            speeds = np.array(self._layout.speeds_m_s)
            row["target_speed"] = speeds[closest_speed(speeds, speed)]
        row["length"], row["width"] = self._models[model].size_m[:2]
        row["axle_m"] = row["length"] * (_BUS_AXLES if label == ObjectClass.BUS else 0.5)
        row["lane"] = row["target_lane"] = self._network.lane_number[slot.lane]
        row["time_wanted"], row["lateral_gain"] = _MANNERS[driver]
        row["timer"] = (row["x"] + row["y"]) * np.pi % 1.0  # as in highway-env: not all change lanes at once
        row["turn_key"] = self._turns_rng.integers(2**63)
        row["movement"] = row["ticket"] = -1
        row["route_length"] = len(slot.route)
        for place, road in enumerate(slot.route):
            self.fleet.routes[k, place] = self._network.road_number[road], -1

    def _start_behind_others(self, count: int) -> None:
        """Of the first `count` rows, let nobody start too fast to stop behind who is right ahead.

        There is less than a metre between two buses in neighbouring slots.
        """
        rows = self.fleet.rows[:count]
        direction = np.column_stack([np.cos(rows["heading"]), np.sin(rows["heading"])])
        offset = self.fleet.position[:count] - self.fleet.position[:count, None]  # (from, to)
        ahead_m = np.einsum("ijk,ik->ij", offset, direction)
        aside_m = np.abs(offset[..., 0] * direction[:, None, 1] - offset[..., 1] * direction[:, None, 0])
        leads = (ahead_m > 0) & (aside_m < LANE_M / 2) & (direction @ direction.T > np.cos(_START_TURN_RAD))
        gap_m = ahead_m - (rows["length"] + rows["length"][:, None]) / 2 - _START_GAP_M
        braked = np.where(leads, 2 * _START_BRAKING_M_S2 * np.maximum(gap_m, 0.0), np.inf)
        for _ in range(count):  # who is slower for one ahead may be too slow for one behind
            slower = np.minimum(rows["speed"], np.sqrt((rows["speed"] ** 2 + braked).min(axis=1, initial=np.inf)))
            if (slower == rows["speed"]).all():
                break
            rows["speed"] = slower

    def _park(self, first: int, count: int, seed: int) -> None:
        """Put vehicles into the rows from `first` on: into bays that have a class of their own, then into any."""
        rng, bays = stream(seed, "parking"), self._layout.bays
        chosen = sorted(rng.permutation(len(bays)).tolist(), key=lambda k: bays[k].label is None)[:count]
        for k, bay in enumerate((bays[number] for number in sorted(chosen)), start=first):
            drawn = ObjectClass.VAN if rng.random() < _PARKED_VANS else ObjectClass.CAR
            fitting = models_of(self._models, drawn if bay.label is None else bay.label)
            row = self.fleet.rows[k]
            row["id"], row["driver"], row["model"] = self._next_id, PARKED, fitting[rng.integers(len(fitting))]
            self._next_id += 1
            row["x"] = bay.x_m + rng.uniform(-PARKED_ASIDE_M, PARKED_ASIDE_M)
            row["y"], row["heading"] = bay.y_m, bay.heading_rad
            row["length"], row["width"] = self._models[row["model"]].size_m[:2]
            row["axle_m"] = row["length"] / 2
            lane = self._layout.network.get_closest_lane_index(np.array([bay.x_m, bay.y_m]), bay.heading_rad)
            row["lane"] = row["target_lane"] = self._network.lane_number[lane]
            row["movement"] = row["ticket"] = -1

    def _keep_together(self) -> None:
        """Who is behind the company's middle goes a little faster, who is ahead a little slower."""
        rows = self.fleet.rows[self._company]
        driving = self._company[(rows["driver"] != CHAUFFEURED) & ~rows["crashed"]]
        if len(driving):
            along_m = self.fleet.rows["x"][driving]
            haste_m_s = np.clip(_GAIN_1_S * (along_m.mean() - along_m), -_HASTE_M_S, _HASTE_M_S)
            if self._layout.convoy_gap_s is not None:  # all close up to the first
                haste_m_s = np.where(along_m == along_m.max(), 0.0, _CLOSING_M_S)
            self.fleet.rows["target_speed"][driving] = self._cruise_m_s + haste_m_s

    def _renew(self, window_m: float) -> None:
        """Replace vehicles that are far from everybody of the company by new ones at the window's edges."""
        rows = self.fleet.rows
        anchors = rows["x"][self._company] if len(self._company) else np.zeros(1)
        wrecked = rows["crashed"][self._company] if len(self._company) else np.ones(1, dtype=np.bool_)
        moving = not wrecked.all()
        edges = anchors[~wrecked] if moving else anchors  # a wreck keeps who is around it, and is soon left behind
        low, high = float(edges.min()) - window_m, float(edges.max()) + window_m
        far = np.abs(anchors[:, None] - rows["x"]).min(axis=0) > window_m
        far[list(self.connected)] = False
        for k in np.flatnonzero(far).tolist():
            self._enter(k, low, high, moving=moving)

    def _enter(self, k: int, low: float, high: float, *, moving: bool) -> None:
        """Replace the vehicle in row `k` by a new one on the same carriageway, in a lane with room; else it goes on.

        Into a window that moves east along with the company, whoever enters from behind is faster, in the passing
        lane if there is room, and whoever is met ahead is slower, so that both come in.
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
                self._spawn(k, HIGHWAY, Slot(index, float(along)), label, speed)
                return

    def _is_free(self, k: int, index: LaneIndex, x: float, speed: float) -> bool:
        """Whether a vehicle that enters a lane (along x) makes nobody brake hard, itself included.

        Who is about to move into the lane counts as in it.
        """
        rows, lane = self.fleet.rows, self._layout.network.get_lane(index)
        in_lane = np.abs(rows["y"] - lane.position(0.0, 0.0)[1]) < 3.0
        in_lane |= rows["target_lane"] == self._network.lane_number[index]
        in_lane[k] = False
        ahead_m = (rows["x"] - x) * np.cos(lane.heading_at(0.0))
        closing_m_s = np.maximum(0.0, (speed - rows["speed"]) * np.sign(ahead_m))
        return not (in_lane & (np.abs(ahead_m) < _ENTRY_M + closing_m_s**2 / (2 * _EASY_BRAKING_M_S2))).any()


def _goes_east(lane: LaneIndex) -> bool:
    return lane[0].startswith("east")
