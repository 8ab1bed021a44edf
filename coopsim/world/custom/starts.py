"""Starts and bays of vehicles, speeds that a policy can choose from, and roadside units."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.world.custom.clearance import MiddleLines, require_space_to_start
from coopsim.world.custom.roads import Roads
from coopsim.world.places.description import PARKED, MapBay, MapStart, MapUnit
from coopsim.world.places.layout import Bay, StartSlot
from coopsim.world.places.road_network import CircularLane, Road
from coopsim.world.places.streets import spaced_slots
from coopsim.world.traffic.movements import GENTLE_M

_STOPPING_M = 14.0  # no starts this close before a stop line: the vehicle could not stop
_APART_M = 14.0  # between two starts in one lane: the longest bus, and the variation of its start
_BESIDE_M = 3.0  # between the middles of two lanes
_PARKED_M = 3.0  # from the middle of a lane to the middle of a parked vehicle


def build_starts(roads: Roads) -> list[tuple[StartSlot, float]]:
    """Return slots, and their ranks among those that become connected."""
    if roads.description.starts is None:
        pieces = [(piece, name) for name, all_of_it in roads.pieces.items() for piece in all_of_it]
        room_m = {piece: _start_length_m(roads, piece) for piece, _ in pieces}
        slots = [slot for piece, _ in pieces for slot in spaced_slots((*piece, 0), room_m[piece])]
        return [(slot, np.inf) for slot in slots if roads.lane(slot.lane[:2]).radius_at(slot.along_m) > GENTLE_M]
    starts = [_start(roads, start, number) for number, start in enumerate(roads.description.starts)]
    _require_apart(roads, [slot for slot, _ in starts])
    require_space_to_start([slot for slot, _ in starts], roads)
    return starts


def _start_length_m(roads: Roads, piece: Road) -> float:
    """Return the length of a piece on which vehicles may start: none on bends and crossings, or right before these."""
    lane = roads.lane(piece)
    if piece in roads.movements or isinstance(lane, CircularLane):
        return 0.0
    ends = not roads.network.graph.get(piece[1])
    stops = ends or any(movement[0] == piece[1] for movement in roads.movements)
    return max(0.0, float(lane.length) - (_STOPPING_M if stops else 0.0))


def _start(roads: Roads, start: MapStart, number: int) -> tuple[StartSlot, float]:
    road = roads.find(start.road, "starts", number, "road")
    entry, length_m = roads.root.part("starts", number), round(roads.length_m(road), 3)
    if not 0 <= start.at_m <= length_m:
        raise entry.part("at_m").error(f"at_m must be in [0, {length_m:g}], got {start.at_m:g}")
    piece, at_m = roads.piece_at(road, float(start.at_m))
    route: list[Road] = []
    if start.route:
        route = roads.pieces[road][roads.pieces[road].index(piece) :]
        for step in pairwise([road[1], *start.route]):
            if step not in roads.pieces:
                message = f"route: there is no road from {step[0]!r} to {step[1]!r}"
                raise entry.part("route").error(message)
            route = [*route, *roads.pieces[step]]
    rank = np.inf if start.connected is None else float(start.connected)
    return StartSlot((*piece, 0), at_m, tuple(route)), rank


def _require_apart(roads: Roads, slots: Sequence[StartSlot]) -> None:
    """Refuse starts too close to each other in one lane."""
    lanes = [roads.network.get_lane(slot.lane) for slot in slots]
    places = np.array([lane.position(slot.along_m, 0.0) for lane, slot in zip(lanes, slots, strict=True)])
    heading = np.array([lane.heading_at(slot.along_m) for lane, slot in zip(lanes, slots, strict=True)])
    offset = places.reshape(-1, 2) - places.reshape(-1, 1, 2)  # (from, to)
    aside_m = np.abs(offset[..., 1] * exact.cos(heading)[:, None] - offset[..., 0] * exact.sin(heading)[:, None])
    same_way = np.abs(wrap_angle(heading - heading[:, None])) < np.pi / 4
    apart_m: Floats = exact.hypot(offset[..., 0], offset[..., 1])
    close = np.argwhere(np.triu(same_way & (aside_m < _BESIDE_M) & (apart_m < _APART_M), 1))
    if len(close):
        first, second = close[0].tolist()
        here, there = (roads.root.part("starts", k) for k in (second, first))
        raise here.error(
            f"starts in one lane must be at least {_APART_M:g} m apart, got {apart_m[first, second]:.1f} m from that "
            f"in {there.spot}"
        )


def build_speeds(roads: Roads) -> tuple[float, ...]:
    """Return the speeds that a policy can choose from; if none are given 0, half and all of the highest limit."""
    speeds = [float(each) for each in roads.description.speeds_m_s]
    if not speeds:
        return (0.0, roads.fastest_m_s / 2, roads.fastest_m_s)
    steps = np.diff(speeds)
    if len(speeds) < 2 or speeds[0] < 0 or steps[0] <= 0 or not np.allclose(steps, steps[0]):
        raise roads.root.part("speeds_m_s").error(
            f"speeds_m_s must be at least two, rising in equal steps from 0 or more, got {speeds}"
        )
    return tuple(speeds)


def build_bay(bay: MapBay, number: int, middles: MiddleLines) -> Bay:
    """Return a bay beside the roads."""
    x, y = map(float, bay.at)
    middles.require_off_roads(np.array([[x, y]]), "at", "parked", number, "at", least_m=_PARKED_M)
    return Bay(x, y, float(np.radians(bay.heading_deg)), None if bay.label is None else PARKED[bay.label])


def build_unit(unit: MapUnit, number: int, root: Entry, middles: MiddleLines) -> SE3:
    """Return `world_SE3_base` of a roadside unit beside the roads."""
    at, ahead = np.array(unit.at, dtype=np.float64), np.subtract(unit.look_at, unit.at)
    middles.require_off_roads(at[None], "at", "rsus", number, "at")
    if not ahead.any():
        raise root.part("rsus", number, "look_at").error("look_at must be another place than at")
    return SE3.from_xyz_yaw([*at, 0.0], float(exact.arctan2(ahead[1], ahead[0])))
