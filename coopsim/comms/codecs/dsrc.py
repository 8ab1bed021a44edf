"""ETSI's messages of lights (SPATEM) and of junctions (MAPEM), TS 103 301, in their own encoding: `dsrc.asn`.

Bits are asn1tools'; here are the conversions between typed content and ASN.1 values in the standards' units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from coopsim.comms.codecs.asn1 import DEGREE_M, compiled, decode_message, encode_message
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.types.intersections import UNKNOWN_MARK, IntersectionMap, MapLane, MovementPhase, SignalPhases

SPATEM, MAPEM = "spatem", "mapem"
"""Names that the messages carry as their codec."""

_IDS = {"SPATEM": 4, "MAPEM": 5}
_STATES: dict[int, str] = {
    MovementPhase.UNAVAILABLE: "unavailable",
    MovementPhase.DARK: "dark",
    MovementPhase.STOP_THEN_PROCEED: "stop-Then-Proceed",
    MovementPhase.RED: "stop-And-Remain",
    MovementPhase.RED_AND_YELLOW: "pre-Movement",
    MovementPhase.GREEN_GIVE_WAY: "permissive-Movement-Allowed",
    MovementPhase.GREEN: "protected-Movement-Allowed",
    MovementPhase.YELLOW_AFTER_GIVE_WAY: "permissive-clearance",
    MovementPhase.YELLOW: "protected-clearance",
    MovementPhase.CAUTION: "caution-Conflicting-Traffic",
}
_PHASES = {name: phase for phase, name in _STATES.items()}
_FIXED_TIMES = (b"\x04\x00", 16)  # the status of an intersection: bit 5, fixedTimeOperation
_KINDS = {"vehicle": ("vehicle", (b"\x00", 8)), "crosswalk": ("crosswalk", (b"\x00\x00", 16))}
_NODES = {f"node-XY{k}": 2 ** (bits - 1) for k, bits in enumerate((10, 11, 12, 13, 14, 16), start=1)}  # largest, cm
_NS_PER_MS, _MS_PER_MINUTE, _MINUTES = 1_000_000, 60_000, 366 * 24 * 60  # of 2004
_UNKNOWN_DM = -4096


@cache
def _module() -> Any:
    return compiled("dsrc.asn", "a message of traffic lights")


def require_dsrc() -> None:
    """Raise `MissingDependencyError` without asn1tools."""
    _module()


def encode_spatem(station_id: int, intersections: Sequence[SignalPhases]) -> bytes:
    """Return a SPATEM with the phases of 1 to 32 junctions.

    Raises:
        CodecError: a value is out of the standard's range, or there are more than 255 signal groups.
        MissingDependencyError: asn1tools is not installed.
    """
    return _encoded("SPATEM", station_id, "spat", {"intersections": [_state_of(each) for each in intersections]})


def decode_spatem(payload: bytes) -> tuple[SignalPhases, ...]:
    """Return the phases of each junction in a SPATEM, of the current event of each signal group.

    Raises:
        CodecError: the bytes are no SPATEM, have parts that coopsim does not read, or do not say when it was made.
    """
    return tuple(_phases_of(each) for each in _decoded("SPATEM", payload)["spat"]["intersections"])


def encode_mapem(station_id: int, intersections: Sequence[IntersectionMap]) -> bytes:
    """Return a MAPEM with 1 to 32 junctions.

    Raises:
        CodecError: a value is out of the standard's range: at most 255 lanes with 2 to 63 points and 16 connections.
        MissingDependencyError: asn1tools is not installed.
    """
    geometry = [_geometry_of(each) for each in intersections]
    return _encoded("MAPEM", station_id, "map", {"msgIssueRevision": 0, "intersections": geometry})


def decode_mapem(payload: bytes) -> tuple[IntersectionMap, ...]:
    """Return the junctions in a MAPEM.

    Raises:
        CodecError: the bytes are no MAPEM, or have parts that coopsim does not read.
    """
    return tuple(_map_of(each) for each in _decoded("MAPEM", payload)["map"].get("intersections", ()))


def _encoded(name: str, station_id: int, body: str, content: Mapping[str, Any]) -> bytes:
    return encode_message(_module(), name, (_IDS[name], station_id), body, content)


def _decoded(name: str, payload: bytes) -> Any:
    return decode_message(_module(), name, _IDS[name], payload)


def _state_of(phases: SignalPhases) -> dict[str, Any]:
    minute, ms = divmod(round(phases.time_ns / _NS_PER_MS), _MS_PER_MINUTE)
    groups: list[int] = phases.group.tolist()
    if len(set(groups)) < len(groups) or 0 in groups:
        raise CodecError(f"signal groups must be distinct numbers from 1 on, got {groups}")
    columns = phases.phase.tolist(), phases.earliest_ds.tolist(), phases.likely_ds.tolist()
    states = [
        {"signalGroup": group, "state-time-speed": [_event(*each)]}
        for group, *each in zip(groups, *columns, strict=True)
    ]
    return {
        "id": {"id": phases.intersection},
        "revision": phases.revision,
        "status": _FIXED_TIMES,
        "moy": minute % _MINUTES,
        "timeStamp": ms,
        "states": states,
    }


def _event(phase: int, earliest_ds: int, likely_ds: int) -> dict[str, Any]:
    if phase not in _STATES:
        raise CodecError(f"a phase must be a MovementPhase, 0 to {max(_STATES)}, got {phase}")
    event: dict[str, Any] = {"eventState": _STATES[phase]}
    if (earliest_ds, likely_ds) != (UNKNOWN_MARK, UNKNOWN_MARK):
        event["timing"] = {"minEndTime": earliest_ds, "likelyTime": likely_ds}
    return event


def _phases_of(state: Mapping[str, Any]) -> SignalPhases:
    minute, ms = state.get("moy", _MINUTES), state.get("timeStamp", 65_535)
    if minute == _MINUTES or ms > _MS_PER_MINUTE:
        raise CodecError(f"intersection {state['id']['id']} must have moy and timeStamp, got {minute} and {ms}")
    events = [each["state-time-speed"][0] for each in state["states"]]
    timing = [each.get("timing", {}) for each in events]
    return SignalPhases(
        state["id"]["id"],
        (minute * _MS_PER_MINUTE + ms) * _NS_PER_MS,
        np.array([each["signalGroup"] for each in state["states"]]),
        np.array([int(_PHASES[each["eventState"]]) for each in events]),
        np.array([each.get("minEndTime", UNKNOWN_MARK) for each in timing]),
        np.array([each.get("likelyTime", UNKNOWN_MARK) for each in timing]),
        state["revision"],
    )


def _geometry_of(intersection: IntersectionMap) -> dict[str, Any]:
    numbers = [intersection.reference, *(lane.points for lane in intersection.lanes)]
    if not all(np.isfinite(each).all() for each in numbers):
        raise CodecError("the reference point and the points of lanes must be finite")
    east, north = (intersection.reference[:2] / DEGREE_M * 1e7).tolist()
    up_m = float(intersection.reference[2])
    geometry = {
        "id": {"id": intersection.intersection},
        "revision": intersection.revision,
        "refPoint": {"lat": round(north), "long": round(east), "elevation": round(up_m * 10)},
        "laneSet": [_lane_of(lane) for lane in intersection.lanes],
    }
    if intersection.lane_width_m is not None:
        geometry["laneWidth"] = round(intersection.lane_width_m * 100)
    return geometry


def _lane_of(lane: MapLane) -> dict[str, Any]:
    if lane.kind not in _KINDS:
        raise CodecError(f"the kind of a lane must be one of {', '.join(_KINDS)} to be written, got {lane.kind!r}")
    use = bytes([lane.approaches << 7 | lane.leaves << 6]), 2
    attributes = {"directionalUse": use, "sharedWith": (b"\x00\x00", 10), "laneType": _KINDS[lane.kind]}
    nodes = ("nodes", _nodes(lane.points))
    found: dict[str, Any] = {"laneID": lane.id, "laneAttributes": attributes, "nodeList": nodes}
    if lane.connections:
        found["connectsTo"] = [
            {"connectingLane": {"lane": to}} | ({} if group is None else {"signalGroup": group})
            for to, group in lane.connections
        ]
    return found


def _nodes(points: Floats) -> list[dict[str, Any]]:
    """Return points (K, 2) m as offsets, each from the one before, in whole centimetres and in the fewest bits."""
    offsets = np.diff(np.rint(points * 100), axis=0, prepend=0.0)
    nodes = []
    for x, y in offsets.tolist():
        fits = [name for name, most in _NODES.items() if -most <= min(x, y) and max(x, y) < most]
        if not fits:
            raise CodecError(f"points of a lane must be at most 327 m apart, got {x / 100:.0f}, {y / 100:.0f} m")
        nodes.append({"delta": (fits[0], {"x": int(x), "y": int(y)})})
    return nodes


def _map_of(geometry: Mapping[str, Any]) -> IntersectionMap:
    at = geometry["refPoint"]
    up_dm = at.get("elevation", _UNKNOWN_DM)
    up_m = 0.0 if up_dm == _UNKNOWN_DM else up_dm / 10
    width_cm = geometry.get("laneWidth")
    return IntersectionMap(
        geometry["id"]["id"],
        np.array([at["long"] * 1e-7 * DEGREE_M, at["lat"] * 1e-7 * DEGREE_M, up_m]),
        tuple(_map_lane(each) for each in geometry["laneSet"]),
        None if width_cm is None else width_cm / 100,
        geometry["revision"],
    )


def _map_lane(lane: Mapping[str, Any]) -> MapLane:
    kind, use = lane["laneAttributes"]["laneType"][0], lane["laneAttributes"]["directionalUse"][0][0]
    offsets = np.array([[node["delta"][1]["x"], node["delta"][1]["y"]] for node in lane["nodeList"][1]])
    return MapLane(
        lane["laneID"],
        kind if kind in _KINDS else "other",
        np.cumsum(offsets, axis=0) / 100,
        bool(use & 0x80),
        bool(use & 0x40),
        tuple((each["connectingLane"]["lane"], each.get("signalGroup")) for each in lane.get("connectsTo", ())),
    )
