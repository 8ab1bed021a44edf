"""All vehicles of an episode on highway-env's road, without its gym layer: who starts where, and who replaces whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from highway_env.road.road import Road

from coopsim.rng import stream
from coopsim.taxonomy import ObjectClass
from coopsim.world.drivers import MANEUVERS, Chauffeured, Driver, HighwayDriver, SizedVehicle, TownDriver
from coopsim.world.junction import Junction
from coopsim.world.layout import LaneIndex, Layout, Slot
from coopsim.world.scenario import Population
from coopsim.world.snapshot import Model

_COMPANY = 6
"""Cars that keep together, unless more of them are connected."""

_GAIN_1_S = 0.1  # how much faster per metre behind the others
_HASTE_M_S = 4.0  # at most
_SLOW, _FAST = (0.8, 0.95), (1.1, 1.3)  # shares of the cruising speed


class Traffic:
    """All vehicles of one episode.

    Args:
        layout: the place.
        population: how many.
        models: shapes to choose from.
        seed: the episode's.
        policy_control: connected cars do as they are told.
    """

    def __init__(
        self,
        layout: Layout,
        population: Population,
        models: Sequence[Model],
        seed: int,
        *,
        policy_control: bool = False,
    ) -> None:
        self._layout, self._models = layout, models
        self._rng = stream(seed, "traffic")
        self.road = Road(layout.network, np_random=stream(seed, "drivers"))
        self._junction = Junction(layout.network, layout.movements) if layout.movements else None
        self._next_id = 1
        slots = self._choose_slots(population)
        trucks = set(self._rng.permutation(len(slots))[: population.trucks].tolist())
        labels = [ObjectClass.TRUCK if k in trucks else ObjectClass.CAR for k in range(len(slots))]
        cars = self._cars(slots, labels)
        connected = cars[: population.connected_cars]
        # Not the connected cars alone, unless a policy drives them: one more of them shall not change the traffic.
        company = connected if policy_control else cars[: max(_COMPANY, len(connected))]
        if not connected or layout.cruise_m_s is None:
            company = []
        self._cruise_m_s = layout.cruise_m_s or 0.0
        for k, (slot, label) in enumerate(zip(slots, labels, strict=True)):
            kind = Chauffeured if policy_control and k in connected else self._usual_driver()
            speed = layout.cruise_m_s if k in company else None
            self.road.vehicles.append(self._spawn(kind, layout.slots[slot], label, speed))
        self.connected: tuple[SizedVehicle, ...] = tuple(self.road.vehicles[k] for k in connected)
        self._company: tuple[SizedVehicle, ...] = tuple(
            self.road.vehicles[k] for k in company if _goes_east(layout.slots[slots[k]].lane)
        )

    @property
    def vehicles(self) -> list[SizedVehicle]:
        """All of them, connected ones included."""
        vehicles: list[SizedVehicle] = self.road.vehicles
        return vehicles

    def step(self, dt_s: float, maneuvers: Mapping[int, int]) -> None:
        """Advance by `dt_s`; `maneuvers` are numbers into `MANEUVERS` by the number of the connected car."""
        for number, maneuver in maneuvers.items():
            self.connected[number].act(MANEUVERS[maneuver].upper())
        if self._junction is not None:
            commanded = [vehicle for vehicle in self.connected if isinstance(vehicle, Chauffeured)]
            self._junction.update(self.vehicles, commanded)
        self._keep_together()
        self.road.act()
        self.road.step(dt_s)
        if self._layout.window_m is not None:
            self._renew(self._layout.window_m)

    def _usual_driver(self) -> type[Driver]:
        return HighwayDriver if self._junction is None else TownDriver

    def _choose_slots(self, population: Population) -> list[int]:
        """Slots of the vehicles, in the layout's order; those that make good connected cars are always taken."""
        first = list(self._layout.connected_first[: max(0, population.vehicles // 3)])
        rest = self._rng.permutation(np.setdiff1d(np.arange(len(self._layout.slots)), first))
        return sorted([*first, *rest[: population.vehicles - len(first)].tolist()])

    def _cars(self, slots: list[int], labels: list[ObjectClass]) -> list[int]:
        """Which vehicles are cars, in the order in which they become connected: one more changes no other."""
        place = {slot: k for k, slot in enumerate(slots)}
        order = [place[slot] for slot in self._layout.connected_first if slot in place]
        return [k for k in order if labels[k] is ObjectClass.CAR]

    def _spawn(
        self, kind: type[SizedVehicle], slot: Slot, label: ObjectClass, speed: float | None = None
    ) -> SizedVehicle:
        lane = self._layout.network.get_lane(slot.lane)
        along = slot.along_m + self._rng.uniform(-1.0, 1.0)
        if speed is None:
            speed = self._rng.uniform(0.75, 1.0) * lane.speed_limit
        vehicle = kind(
            self.road,
            lane.position(along, 0.0),
            lane.heading_at(along),
            speed=speed,
            target_lane_index=slot.lane,
            target_speed=speed,
        )
        fitting = [index for index, model in enumerate(self._models) if model.label == label]
        index = fitting[self._rng.integers(len(fitting))]
        vehicle.fit(self._next_id, index, self._models[index])
        self._next_id += 1
        if isinstance(vehicle, TownDriver) and self._junction is not None:
            vehicle.junction = self._junction
        if isinstance(vehicle, Chauffeured):
            vehicle.choose_among(self._layout.speeds_m_s)
        return vehicle

    def _keep_together(self) -> None:
        """Who is behind the company's middle goes a little faster, who is ahead a little slower."""
        driving = [vehicle for vehicle in self._company if isinstance(vehicle, Driver) and not vehicle.crashed]
        along_m = np.array([vehicle.position[0] for vehicle in driving])
        haste_m_s = np.clip(_GAIN_1_S * (along_m.sum() / max(len(driving), 1) - along_m), -_HASTE_M_S, _HASTE_M_S)
        for vehicle, more in zip(driving, haste_m_s.tolist(), strict=True):
            vehicle.target_speed = self._cruise_m_s + more

    def _renew(self, window_m: float) -> None:
        """Replace vehicles that are far from everybody of the company by new ones at the window's edges."""
        anchors = np.array([vehicle.position[0] for vehicle in self._company] or [0.0])
        wrecked = np.array([vehicle.crashed for vehicle in self._company] or [True])
        moving = not wrecked.all()
        edges = anchors[~wrecked] if moving else anchors  # a wreck keeps who is around it, and is soon left behind
        low, high = float(edges.min()) - window_m, float(edges.max()) + window_m
        for k, vehicle in enumerate(self.road.vehicles):
            if np.abs(anchors - vehicle.position[0]).min() > window_m and vehicle not in self.connected:
                self.road.vehicles[k] = self._enter(vehicle, low, high, moving=moving)

    def _enter(self, gone: SizedVehicle, low: float, high: float, *, moving: bool) -> SizedVehicle:
        """A new vehicle for one that left, on the same carriageway, in a lane with room; else `gone` goes on.

        Into a window that moves east along with the company, whoever enters from behind is faster, in the passing
        lane if there is room, and whoever is met ahead is slower, so that both come in.
        """
        start, end, _ = gone.lane_index
        lanes = self._rng.permutation(len(self._layout.network.graph[start][end]))
        eastward, speed = _goes_east(gone.lane_index), None
        ahead = not eastward
        if eastward and moving:
            ahead = bool(self._rng.random() < 0.5)
            lanes = np.sort(lanes)[:: -1 if ahead else 1]
            speed = self._cruise_m_s * self._rng.uniform(*(_SLOW if ahead else _FAST))
        x = high - 5.0 if ahead else low + 5.0
        label = ObjectClass(self._models[gone.model].label)
        for number in lanes.tolist():
            index = (start, end, number)
            lane = self._layout.network.get_lane(index)
            y = lane.position(0.0, 0.0)[1]
            near = [v for v in self.road.vehicles if abs(v.position[0] - x) < 30 and abs(v.position[1] - y) < 3]
            if not [v for v in near if v is not gone]:
                along = lane.local_coordinates(np.array([x, y]))[0]
                return self._spawn(HighwayDriver, Slot(index, float(along)), label, speed)
        return gone


def _goes_east(lane: LaneIndex) -> bool:
    return lane[0].startswith("east")
