"""Messages of planned ways (MCM) and of hard brakes (DENM), in their own encoding: `maneuvers.asn`.

Bits are asn1tools'; here are the conversions between typed content and ASN.1 values in the standards' units.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from coopsim.comms.codecs.asn1 import compiled, decode_message, encode_message
from coopsim.comms.codecs.cpm_codec import asn1_position, position_of, require_on_earth
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types.intents import HardBrake, PlannedPath

MCM, DENM = "mcm", "denm"
"""Names that the messages carry as their codec."""

MCM_ID, DENM_ID = 20, 1
"""Numbers of the messages in ETSI's list."""

CYCLE_NS = 65_536 * 10**6
"""Time after which the time in an MCM begins anew."""

_CAR, _AUTOMATED = 5, "connectedAutomatedVehicle"
_OUT_OF_RANGE_DM, _FASTEST = 61, 16_381
_HARD_BRAKE = {"causeCode": 99, "subCauseCode": 1}  # dangerous situation: emergency electronic brake engaged
_VALID_S, _EVERY_MS = 2, 100
_UNKNOWN, _MOST_POINTS = 127, 128
_NS_PER_MS = 1_000_000


@cache
def _module() -> Any:
    return compiled("maneuvers.asn", 'uplink="intents"')


def require_maneuvers() -> None:
    """Raise `MissingDependencyError` without asn1tools."""
    _module()


def encode_mcm(path: PlannedPath) -> bytes:
    """Return an MCM with a planned way of 1 to 128 points.

    Raises:
        CodecError: a value is out of the standard's range.
        MissingDependencyError: asn1tools is not installed.
    """
    _require_finite(path.position, path.points, path.heading_rad, path.speed_m_s)
    require_on_earth(path.position)
    offsets = np.rint(path.points * 100).astype(np.int64).tolist()
    columns = offsets, _speeds(path.speed_m_s), _headings(path.heading_rad)
    points = [
        {"waypoint": {"xDistance": x, "yDistance": y}, "speed": speed, "heading": heading}
        for (x, y), speed, heading in zip(*columns, strict=True)
    ]
    if not 1 <= len(points) <= _MOST_POINTS:  # the extension mark would allow more
        raise CodecError(f"a planned way must have 1 to {_MOST_POINTS} points, got {len(points)}")
    state = {"roadUserType": _AUTOMATED, "speed": points[0]["speed"], "heading": points[0]["heading"]}
    trajectory = {
        "startDeltaTime": round(path.first_s * 1e3),
        "deltaTime": round(path.step_s * 1e3),
        "trajectoryPointContainer": points,
    }
    container = {
        "roadUserState": state | {"length": _size(path.length_m), "width": _size(path.width_m)},
        "plannedTrajectory": trajectory,
    }
    parameters = {
        "basicContainer": {"stationType": _CAR, "referencePosition": asn1_position(path.position)},
        "maneuverContainer": ("roadUserContainer", container),
    }
    content = {"generationDeltaTime": round(path.time_ns % CYCLE_NS / _NS_PER_MS) % 65_536, "mcmParameters": parameters}
    return encode_message(_module(), "MCM", (MCM_ID, path.station), "mcm", content)


def decode_mcm(payload: bytes) -> PlannedPath:
    """Return the planned way in an MCM; its time is the one in the message, below 65.536 s.

    Raises:
        CodecError: the bytes are no MCM, have parts that coopsim does not read, or no whole planned way.
    """
    message = decode_message(_module(), "MCM", MCM_ID, payload)
    parameters = message["mcm"]["mcmParameters"]
    container = parameters["maneuverContainer"][1]
    trajectory, state = container.get("plannedTrajectory"), container["roadUserState"]
    if trajectory is None:
        raise CodecError("the MCM has no plannedTrajectory")
    points = trajectory["trajectoryPointContainer"]
    rows = np.array([[*each["waypoint"].values(), each["speed"], each["heading"]] for each in points], dtype=np.float64)
    if np.abs(rows[:, :2]).max() > 131_070 or rows[:, 2].max() > _FASTEST or rows[:, 3].max() >= 3600:
        raise CodecError("the points of an MCM must have places, speeds and headings in range")
    position = position_of(parameters["basicContainer"]["referencePosition"])
    require_on_earth(position)
    return PlannedPath(
        message["header"]["stationID"],
        message["mcm"]["generationDeltaTime"] * _NS_PER_MS,
        position,
        rows[:, :2] / 100,
        wrap_angle(np.radians(90.0 - rows[:, 3] / 10)),
        rows[:, 2] / 100,
        trajectory["startDeltaTime"] / 1e3,
        trajectory["deltaTime"] / 1e3,
        *(_metres(state[name]) for name in ("length", "width")),
    )


def encode_denm(brake: HardBrake) -> bytes:
    """Return a DENM that warns of a hard brake.

    Raises:
        CodecError: a value is out of the standard's range.
        MissingDependencyError: asn1tools is not installed.
    """
    motion = np.array([brake.heading_rad]), np.array([brake.speed_m_s])
    _require_finite(brake.position, *motion)
    require_on_earth(brake.position)
    management = {
        "actionID": {"originatingStationID": brake.station, "sequenceNumber": brake.number},
        "detectionTime": round(brake.began_ns / _NS_PER_MS),
        "referenceTime": round(brake.time_ns / _NS_PER_MS),
        "eventPosition": asn1_position(brake.position),
        "validityDuration": _VALID_S,
        "transmissionInterval": _EVERY_MS,
        "stationType": _CAR,
    }
    location = {
        "eventSpeed": {"speedValue": _speeds(motion[1])[0], "speedConfidence": _UNKNOWN},
        "eventPositionHeading": {"headingValue": _headings(motion[0])[0], "headingConfidence": _UNKNOWN},
        "traces": [[]],
    }
    situation = {"informationQuality": 0, "eventType": _HARD_BRAKE}
    content = {"management": management, "situation": situation, "location": location}
    return encode_message(_module(), "DENM", (DENM_ID, brake.station), "denm", content)


def decode_denm(payload: bytes) -> HardBrake:
    """Return the hard brake that a DENM warns of.

    Raises:
        CodecError: the bytes are no DENM, have parts that coopsim does not read, or warn of something else.
    """
    message = decode_message(_module(), "DENM", DENM_ID, payload)
    body = message["denm"]
    event, location, management = (
        body.get("situation", {}).get("eventType"),
        body.get("location", {}),
        body["management"],
    )
    if event != _HARD_BRAKE or "termination" in management:
        raise CodecError(f"a DENM must warn of a hard brake, {_HARD_BRAKE}, got {event}")
    speed = location.get("eventSpeed", {}).get("speedValue", _FASTEST + 1)
    heading = location.get("eventPositionHeading", {}).get("headingValue", 3601)
    if speed > _FASTEST or heading >= 3600:
        raise CodecError("a DENM of a hard brake must have eventSpeed and eventPositionHeading in range")
    position = position_of(management["eventPosition"])
    require_on_earth(position)
    return HardBrake(
        management["actionID"]["originatingStationID"],
        management["actionID"]["sequenceNumber"],
        management["detectionTime"] * _NS_PER_MS,
        management["referenceTime"] * _NS_PER_MS,
        position,
        float(wrap_angle(np.radians(90.0 - heading / 10))),
        speed / 100,
    )


def latest_ns(path: PlannedPath, now_ns: int) -> int:
    """Return the latest time until now at which an MCM with this time can have been made."""
    return now_ns - (now_ns - path.time_ns) % CYCLE_NS


def _require_finite(*numbers: Floats) -> None:
    if not all(np.isfinite(each).all() for each in numbers):
        raise CodecError("positions, headings and speeds must be finite")


def _speeds(speed_m_s: Floats) -> list[int]:
    whole = np.rint(speed_m_s * 100)
    if whole.min(initial=0) < 0 or whole.max(initial=0) > _FASTEST:
        raise CodecError(f"speeds must be in [0, {_FASTEST / 100}] m/s, got {speed_m_s.tolist()}")
    return [int(each) for each in whole]


def _headings(heading_rad: Floats) -> list[int]:
    """Return headings as tenths of degrees, clockwise from the north."""
    return [int(each) for each in np.rint((90.0 - np.degrees(heading_rad)) * 10) % 3600]


def _size(size_m: float) -> int:
    """Return a length or width in decimetres; of more than 6 m, and of unknown ones, the standard's marks."""
    if np.isnan(size_m):
        return _OUT_OF_RANGE_DM + 1
    return min(max(round(size_m * 10), 1), _OUT_OF_RANGE_DM)


def _metres(size_dm: int) -> float:
    return size_dm / 10 if size_dm < _OUT_OF_RANGE_DM else np.nan
