"""Edges of a place that is cut out of a map: vehicles that leave it come in again elsewhere, out of sight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Mask
from coopsim.world.places.layout import Layout, StartSlot
from coopsim.world.places.road_network import LaneIndex
from coopsim.world.traffic.fleet import PARKED, Fleet
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.rules import VEHICLE_LENGTH_M

SIGHT_M = 150.0
"""Farther from all connected cars and roadside units a vehicle may appear in plain view."""

_ENTRY_M = 4.0  # from a lane's start to where the middle of a vehicle appears
_ROOM_M, _BEHIND_M = 16.0, 8.0  # free lane that it needs ahead of its middle, and behind
_BESIDE_M = 2.5  # from the lane's middle to vehicles that are in it
_LEAST_M = 18.0  # length of lanes on which vehicles appear, where there are such
_FAR_M = 200.0  # vehicles farther off do not matter
_GAP_M, _BRAKING_M_S2 = 10.0, 3.0  # kept from a vehicle ahead after braking


class Edges:
    """The ends and beginnings of lanes at the edge of a place.

    Args:
        layout: the place.
        network: its roads.
        seed: seed of the episode.
    """

    def __init__(self, layout: Layout, network: NumberedNetwork, seed: int) -> None:
        graph = layout.network.graph
        reached = {end for ends in graph.values() for end in ends}
        entries = [index for index in network.lane_index if index[0] not in reached]
        self._entries = [index for index in entries if _has_room(layout, index)] or entries
        self._traffic = np.array([layout.network.traffic_per_h.get(index[:2], 0.0) for index in self._entries])
        self._lanes = [layout.network.get_lane(index) for index in self._entries]
        ends = [k for k, index in enumerate(network.lane_index) if not graph.get(index[1])]
        self._exits = np.array(ends, dtype=np.int64)
        self._network, self._rng = network, stream(seed, "edges")
        self._units = np.array([unit.translation[:2] for unit in layout.rsus]).reshape(-1, 2)
        outlines = layout.road_map.buildings
        self._walls = np.concatenate([np.zeros((0, 4)), *(np.hstack([o, np.roll(o, -1, axis=0)]) for o in outlines)])

    def leaving(self, fleet: Fleet) -> list[int]:
        """Return the rows of vehicles at the end of a lane that ends."""
        rows, found = fleet.rows, []
        for k in np.flatnonzero(np.isin(rows["target_lane"], self._exits) & (rows["driver"] != PARKED)).tolist():
            lane = self._network.source.get_lane(self._network.lane_index[rows["target_lane"][k]])
            if lane.local_coordinates(fleet.position[k])[0] > lane.length - VEHICLE_LENGTH_M / 2:
                found.append(k)
        return found

    def hold(self, fleet: Fleet, connected: Sequence[int]) -> None:
        """Let vehicles stop at the ends of lanes as long as there is no room to come in; connected cars always do."""
        rows = fleet.rows
        nears = np.isin(rows["target_lane"], self._exits)
        nears[list(connected)] = False
        if nears.any():
            rows["ends"][nears] = not any(self._room_m(fleet, k) > _ROOM_M for k in range(len(self._entries)))

    def entry(self, fleet: Fleet, eyes: Sequence[int]) -> tuple[StartSlot, float] | None:
        """Return a place to come in and the highest speed there (m/s); None if there is no room.

        One that is out of the sight of the vehicles in the rows `eyes` and of roadside units is drawn, by its traffic
        where that is known; without any, the one that is farthest from all of them is taken.
        """
        free = [(k, room_m) for k in range(len(self._entries)) if (room_m := self._room_m(fleet, k)) > _ROOM_M]
        if not free:
            return None
        places = np.array([self._lanes[k].position(_ENTRY_M, 0.0) for k, _ in free])
        seen_from = np.concatenate([fleet.position[list(eyes)], self._units])
        hidden = np.flatnonzero(~self._is_seen(places, seen_from))
        traffic = self._traffic[[free[n][0] for n in hidden.tolist()]]
        shares = traffic / traffic.sum() if traffic.any() else None
        chosen = int(self._rng.choice(hidden, p=shares)) if len(hidden) else self._farthest(places, seen_from)
        k, room_m = free[chosen]
        return StartSlot(self._entries[k], _ENTRY_M), float(np.sqrt(2 * _BRAKING_M_S2 * (room_m - _GAP_M)))

    def _room_m(self, fleet: Fleet, k: int) -> float:
        """Return the free length of a lane ahead of the place where vehicles appear, as far as it goes, m."""
        lane, position, room_m = self._lanes[k], fleet.position, self._lanes[k].length + _ROOM_M - _ENTRY_M
        for n in np.flatnonzero(exact.norm(position - lane.position(_ENTRY_M, 0.0)) < _FAR_M).tolist():
            along, aside = lane.local_coordinates(position[n])
            half_m = float(fleet.rows["length"][n]) / 2
            if abs(aside) < _BESIDE_M and along + half_m > _ENTRY_M - _BEHIND_M:
                room_m = min(room_m, along - half_m - _ENTRY_M)
        return room_m

    def _farthest(self, places: Floats, seen_from: Floats) -> int:
        if not len(seen_from):
            return 0
        return int(exact.norm(places[:, None] - seen_from, axis=2).min(axis=1).argmax())

    def _is_seen(self, places: Floats, seen_from: Floats) -> Mask:
        """Return the mask (E,) of places (E, 2) m within sight of one of some points (A, 2) m, before no building."""
        offset = places[:, None] - seen_from
        near: Mask = exact.norm(offset, axis=2) < SIGHT_M
        seen = np.zeros(len(places), np.bool_)
        for e, a in np.argwhere(near).tolist():
            seen[e] = seen[e] or not _is_crossed(seen_from[a], places[e], self._walls)
        return seen


def _has_room(layout: Layout, entry: LaneIndex) -> bool:
    """Return whether vehicles that appear on a lane can wait before the first junction."""
    return entry[:2] not in layout.movements and layout.network.get_lane(entry).length >= _LEAST_M


def _is_crossed(start: Floats, end: Floats, walls: Floats) -> bool:
    """Return whether a line from one point (2,) m to another crosses one of walls (W, 4), from x, y to x, y."""
    a, b = walls[:, :2], walls[:, 2:]
    sides = _side(start, end, a) * _side(start, end, b) < 0
    return bool((sides & (_side(a, b, start) * _side(a, b, end) < 0)).any())


def _side(start: Floats, end: Floats, point: Floats) -> Floats:
    """Return a number that is positive where a point is to the left of a line, negative to its right."""
    along, offset = end - start, point - start
    left: Floats = along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0]
    return left
