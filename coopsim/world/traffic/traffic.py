"""All vehicles of an episode: their start, the company of connected cars, and replacements on the highway."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coopsim.support.checks import require_choice
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model
from coopsim.world.places.layout import Layout, StartSlot
from coopsim.world.places.road_network import LaneIndex, Road
from coopsim.world.population import Population
from coopsim.world.traffic.engine.array_engine import ArrayEngine
from coopsim.world.traffic.engine.fleet import CHAUFFEURED, HIGHWAY, TOWN, VEHICLE, Fleet
from coopsim.world.traffic.engine.lanes import NumberedNetwork
from coopsim.world.traffic.spawning import Spawner, slow_down_behind_others

_COMPANY = 6
"""Cars that keep together, unless more of them are connected."""

_GAIN_1_S = 0.1  # haste per metre behind the company's middle
_HASTE_M_S = 4.0  # at most
_CLOSING_M_S = 9.0  # extra target speed in a convoy behind its first car
_SLOW, _FAST = (0.8, 0.95), (1.1, 1.3)  # shares of the cruising speed
_ENTRY_M = 30.0  # free road that a new vehicle needs ahead and behind, next to what it takes to adapt its speed
_EASY_BRAKING_M_S2 = 2.0


class Engine(Protocol):
    """Moves a fleet."""

    def step(self, fleet: Fleet, people: NDArray[Any], dt_s: float, maneuvers: Mapping[int, int]) -> None:
        """Advance by `dt_s` among people (M,) `BODY`; `maneuvers` are indices into `MANEUVERS` by row."""


_Roads = Sequence[Road]


def _highway_env(
    network: NumberedNetwork, movements: _Roads, speeds_m_s: Sequence[float], priority: _Roads, clearance_m: float
) -> Engine:
    # Importing highway-env takes a second.
    from coopsim.world.traffic.highway_reference.reference_engine import ReferenceEngine

    return ReferenceEngine(network, movements, speeds_m_s, priority, clearance_m)


ENGINES: dict[str, Callable[[NumberedNetwork, _Roads, Sequence[float], _Roads, float], Engine]] = {
    "arrays": ArrayEngine,
    "highway-env": _highway_env,
}


class Traffic:
    """All vehicles of one episode.

    Args:
        layout: the place.
        population: numbers of vehicles.
        models: shapes to choose from.
        seed: the episode's.
        policy_control: connected cars obey maneuvers.
        engine: one of `ENGINES`.

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
        policy_control: bool = False,
        engine: str = "arrays",
    ) -> None:
        require_choice("traffic", engine, ENGINES)
        self._layout, self._models = layout, models
        self._network = NumberedNetwork(layout.network)
        self._spawner = Spawner(layout, self._network, models, seed)
        self._rng = self._spawner.rng
        self._engine = ENGINES[engine](
            self._network, layout.movements, layout.speeds_m_s, layout.priority, layout.clearance_m
        )
        slots, labels = self._spawner.choose_starts(population)
        cars = self._cars(slots, labels)
        self.connected = tuple(cars[: population.connected])
        # Not only the connected cars, unless a policy drives them: another connected car must not change the traffic.
        company = list(self.connected) if policy_control else cars[: max(_COMPANY, len(self.connected))]
        if not self.connected or layout.cruise_m_s is None:
            company = []
        self._cruise_m_s = layout.cruise_m_s or 0.0
        count = len(slots) + population.parked
        roads_ahead = max([layout.roads_ahead, *(len(slot.route) for slot in layout.slots)])
        self.fleet = Fleet(np.zeros(count, VEHICLE), np.zeros((count, roads_ahead, 2), np.int64))
        usual_driver = TOWN if layout.window_m is None else HIGHWAY
        for k, (slot, label) in enumerate(zip(slots, labels, strict=True)):
            driver = CHAUFFEURED if policy_control and k in self.connected else usual_driver
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

    def step(self, dt_s: float, maneuvers: Mapping[int, int], people: NDArray[Any]) -> None:
        """Advance by `dt_s`.

        Args:
            dt_s: time step.
            maneuvers: indices into `coopsim.types.maneuvers.MANEUVERS` by the number of the connected car.
            people: (M,) `coopsim.world.traffic.engine.fleet.BODY`, obstacles for vehicles.
        """
        self._keep_together()
        by_row = {self.connected[number]: maneuver for number, maneuver in maneuvers.items()}
        self._engine.step(self.fleet, people, dt_s, by_row)
        if self._layout.window_m is not None:
            self._renew(self._layout.window_m)

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
        driving = company[(rows["driver"][company] != CHAUFFEURED) & ~rows["crashed"][company]]
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
        ahead_m = (rows["x"] - x) * np.cos(lane.heading_at(0.0))
        closing_m_s = np.maximum(0.0, (speed - rows["speed"]) * np.sign(ahead_m))
        return not (in_lane & (np.abs(ahead_m) < _ENTRY_M + closing_m_s**2 / (2 * _EASY_BRAKING_M_S2))).any()


def _goes_east(lane: LaneIndex) -> bool:
    return lane[0].startswith("east")
