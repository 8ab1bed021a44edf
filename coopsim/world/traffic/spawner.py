"""The vehicles of an episode at their start: places, models, manners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import draw_models, models_of
from coopsim.world.models.model import Model
from coopsim.world.places.layout import LANE_M, Layout, StartSlot
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.population import Population
from coopsim.world.script import VehicleRole
from coopsim.world.traffic.array_engine import closest_speed
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
from coopsim.world.traffic.lane_geometry import closest_lane
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.rules import LONG_M, PARKED_ASIDE_M

_BRAKING_M_S2 = 5.0  # of a vehicle that starts right behind a slower one
_STAND_M, _LINE_BRAKING_M_S2 = 8.0, 3.0  # from the middle of a waiting car to its line; braking before it
_GAP_M = 0.5  # left when it has braked
_TURN_RAD = 0.3  # a vehicle with another heading is not ahead

_AXLES = 0.25  # from the middle, in lengths: half a length apart, as the models of buses have them

_RAREST = 1000.0  # least traffic of a lane, as a part of the most: its starts are taken last

_PARKED_VANS = 0.15  # share of vans, where a bay has no class of its own

# Time gap (s) and lateral gain (1/s). highway-env's 1.5 s would fill the lanes of a highway, and leave no gap to pass;
# with its 1.67 a car turns by 15 degrees at 25 m/s, and back, in a second.
_MANNERS = {TOWN: (1.5, 1 / 0.6), HIGHWAY: (1.0, 0.5), CHAUFFEURED: (1.5, 1 / 0.6), PEDALLED: (1.5, 1 / 0.6)}
_MANNERS |= dict.fromkeys((UNYIELDING, PARKED, STEERED), _MANNERS[TOWN])


class Spawner:
    """Makes the vehicles of an episode.

    Attributes:
        rng: draws of traffic.
    """

    def __init__(self, layout: Layout, network: NumberedNetwork, models: Sequence[Model], seed: int) -> None:
        self._layout, self._network, self._models, self._seed = layout, network, models, seed
        self.rng, self._turns_rng = stream(seed, "traffic"), stream(seed, "drivers")
        self._next_id = 1
        self._lines = {start for start, _ in layout.movements}
        # Trucks with axles at their ends, as highway-env has them, cannot follow the bends of maps.
        self._curved = any(isinstance(lane, PolylineLane) for lane in layout.network.lanes.values())

    def choose_starts(self, population: Population) -> tuple[list[int], list[int]]:
        """Return the slots of the vehicles, ascending, and their classes.

        Good slots for connected cars are always taken, and get cars if the layout asks for it.
        """
        count = sum(population.on_roads.values())
        first = list(self._layout.connected_order[: count // 3])
        rest = self._drawn(np.setdiff1d(np.arange(len(self._layout.slots)), first))
        slots = sorted([*first, *rest[: count - len(first)].tolist()])
        labels = self.rng.permutation([label for label, n in population.on_roads.items() for _ in range(n)]).tolist()
        return slots, self._with_cars_first(slots, labels)

    def _drawn(self, slots: Ints) -> Ints:
        """Return slots in an order that is drawn: by the traffic of their lanes, where that is known."""
        traffic = self._layout.network.traffic_per_h
        if not traffic or not len(slots):
            return self.rng.permutation(slots)
        shares = np.array([traffic.get(self._layout.slots[k].lane[:2], 0.0) for k in slots.tolist()])
        shares = np.maximum(shares, max(shares.max(), 1.0) / _RAREST)
        return self.rng.choice(slots, len(slots), replace=False, p=shares / shares.sum())

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
        if self._layout.cut:
            row["speed"] = min(speed, self._stopping_m_s(start))
        if driver == CHAUFFEURED:
            speeds = np.array(self._layout.speeds_m_s)
            row["target_speed"] = speeds[closest_speed(speeds, speed)]

    def _stopping_m_s(self, start: StartSlot) -> float:
        """Return the speed from which a new vehicle can stop where it may have to wait, at the end of its lane."""
        if start.lane[1] not in self._lines:
            return np.inf
        left_m = self._layout.network.get_lane(start.lane).length - start.along_m - _STAND_M
        return float(np.sqrt(2 * _LINE_BRAKING_M_S2 * max(left_m, 0.0)))

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
        overhangs = self._models[model].label == ObjectClass.BUS or (self._curved and row["length"] > LONG_M)
        row["axle_m"] = row["length"] * (_AXLES if overhangs else 0.5)
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
            lanes, corners = self._network.arrays.lanes, self._network.arrays.corners
            lane = closest_lane(lanes, corners, bay.x_m, bay.y_m, bay.heading_rad, 0)
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


_LINE_BRAKING_M_S2, _BEFORE_LINE_M = 2.5, 3.0  # of a vehicle that starts near a light, and where its front then stands


def slow_down_before_lines(fleet: Fleet, count: int, stop_lines: Sequence[Floats]) -> None:
    """Limit the speeds of the first `count` vehicles so that each can stop before a line (2, 2) m of traffic lights."""
    rows, lines = fleet.rows[:count], np.array(stop_lines).reshape(-1, 2, 2)
    direction = np.column_stack([exact.cos(rows["heading"]), exact.sin(rows["heading"])])
    across = lines[:, 1] - lines[:, 0]
    travel = np.column_stack([across[:, 1], -across[:, 0]]) / exact.norm(across, axis=1)[:, None]
    offset = lines.mean(axis=1) - fleet.position[:count, None]
    ahead_m = exact.dot(offset, direction[:, None])
    aside_m = np.abs(offset[..., 0] * direction[:, None, 1] - offset[..., 1] * direction[:, None, 0])
    leads = (ahead_m > 0) & (aside_m < LANE_M / 2) & (exact.dot(direction[:, None], travel) > exact.cos(_TURN_RAD))
    free_m = np.maximum(ahead_m - rows["length"][:, None] / 2 - _BEFORE_LINE_M, 0.0)
    most_m_s = np.sqrt(np.where(leads, 2 * _LINE_BRAKING_M_S2 * free_m, np.inf).min(axis=1, initial=np.inf))
    rows["speed"] = np.minimum(rows["speed"], most_m_s)
