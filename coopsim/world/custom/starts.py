"""Starts and bays of vehicles, speeds that a policy can choose from, and roadside units, from a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.checks import require_between, require_count, require_finite_number
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.custom.clearance import MiddleLines, require_space_to_start
from coopsim.world.custom.roads import Roads
from coopsim.world.places.layout import Bay, StartSlot
from coopsim.world.places.road_network import CircularLane, Road
from coopsim.world.places.streets import spaced_slots

START_KEYS: tuple[tuple[str, ...], tuple[str, ...]] = (("road", "at_m"), ("route", "connected"))
"""Keys that a start needs, and further ones."""

BAY_KEYS: tuple[tuple[str, ...], tuple[str, ...]] = (("at", "heading_deg"), ("label",))
"""Keys that a bay needs, and further ones."""

UNIT_KEYS: tuple[tuple[str, ...], tuple[str, ...]] = (("at", "look_at"), ())
"""Keys that a roadside unit needs, and further ones."""

_STOPPING_M = 14.0  # no starts this close before a stop line: the vehicle could not stop
_APART_M = 14.0  # between two starts in one lane: the longest bus, and the variation of its start
_BESIDE_M = 3.0  # between the middles of two lanes
_PARKED_M = 3.0  # from the middle of a lane to the middle of a parked vehicle
_PARKED = {label.title: label for label in ObjectClass if label not in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)}


def read_starts(roads: Roads, fields: Mapping[str, Entry]) -> list[tuple[StartSlot, float]]:
    """Return slots, and their ranks among those that become connected, from the entries of a place."""
    if "starts" not in fields:
        pieces = [(piece, name) for name, all_of_it in roads.pieces.items() for piece in all_of_it]
        room_m = {piece: _start_length_m(roads, piece) for piece, _ in pieces}
        slots = [slot for piece, _ in pieces for slot in spaced_slots((*piece, 0), room_m[piece])]
        return [(slot, np.inf) for slot in slots]
    items = fields["starts"].entries()
    starts = [_start(roads, item) for item in items]
    _require_apart(roads, [slot for slot, _ in starts], items)
    require_space_to_start([slot for slot, _ in starts], items, roads)
    return starts


def _start_length_m(roads: Roads, piece: Road) -> float:
    """Return the length of a piece on which vehicles may start: none on bends and crossings, or right before these."""
    lane = roads.lane(piece)
    if piece in roads.movements or isinstance(lane, CircularLane):
        return 0.0
    stops = any(movement[0] == piece[1] for movement in roads.movements)
    return max(0.0, float(lane.length) - (_STOPPING_M if stops else 0.0))


def _start(roads: Roads, entry: Entry) -> tuple[StartSlot, float]:
    fields = entry.fields(*START_KEYS)
    road = roads.find(fields["road"])
    along_m = float(fields["at_m"].checked(require_between, 0, round(roads.length_m(road), 3)))
    piece, at_m = roads.piece_at(road, along_m)
    route: list[Road] = []
    if "route" in fields:
        route = roads.pieces[road][roads.pieces[road].index(piece) :]
        nodes = [road[1], *(item.choice(roads.nodes, "node") for item in fields["route"].entries())]
        for step in pairwise(nodes):
            if step not in roads.pieces:
                raise fields["route"].error(f"route: there is no road from {step[0]!r} to {step[1]!r}")
            route = [*route, *roads.pieces[step]]
    rank = float(fields["connected"].checked(require_count, 1)) if "connected" in fields else np.inf
    return StartSlot((*piece, 0), at_m, tuple(route)), rank


def _require_apart(roads: Roads, slots: Sequence[StartSlot], entries: Sequence[Entry]) -> None:
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
        raise entries[second].error(
            f"starts in one lane must be at least {_APART_M:g} m apart, got {apart_m[first, second]:.1f} m from that "
            f"in {entries[first].spot}"
        )


def read_speeds(roads: Roads, fields: Mapping[str, Entry]) -> tuple[float, ...]:
    """Return the speeds from the entries of a place; without an entry 0, half and all of the highest limit."""
    if "speeds_m_s" not in fields:
        return (0.0, roads.fastest_m_s / 2, roads.fastest_m_s)
    speeds = fields["speeds_m_s"].numbers()
    steps = np.diff(speeds)
    if len(speeds) < 2 or speeds[0] < 0 or steps[0] <= 0 or not np.allclose(steps, steps[0]):
        raise fields["speeds_m_s"].error(
            f"speeds_m_s must be at least two, rising in equal steps from 0 or more, got {speeds}"
        )
    return tuple(speeds)


def read_bay(entry: Entry, middles: MiddleLines) -> Bay:
    """Return a bay beside the roads."""
    fields = entry.fields(*BAY_KEYS)
    at = fields["at"].point()
    middles.require_off_roads(at[None], fields["at"], "at", _PARKED_M)
    heading_deg = float(fields["heading_deg"].checked(require_finite_number))
    label = _PARKED[fields["label"].choice(_PARKED)] if "label" in fields else None
    return Bay(float(at[0]), float(at[1]), float(np.radians(heading_deg)), label)


def read_unit(entry: Entry, middles: MiddleLines) -> SE3:
    """Return `world_SE3_base` of a roadside unit beside the roads."""
    fields = entry.fields(*UNIT_KEYS)
    at, ahead = fields["at"].point(), fields["look_at"].point() - fields["at"].point()
    middles.require_off_roads(at[None], fields["at"], "at")
    if not ahead.any():
        raise fields["look_at"].error("look_at must be another place than at")
    return SE3.from_xyz_yaw([*at, 0.0], float(exact.arctan2(ahead[1], ahead[0])))
