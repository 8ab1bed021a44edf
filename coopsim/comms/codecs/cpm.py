"""ETSI's Collective Perception Message (TS 103 324), in its own encoding: a subset, see `cpm.asn` and `docs/codecs.md`.

The world frame is taken for east, north and up around a point on the equator, `ORIGIN`: a metre is 1e7 / 111,319.49
units of latitude and of longitude. An episode begins when ETSI's time does, at 2004-01-01T00:00:00Z.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from coopsim.arrays import frozen
from coopsim.comms.codecs.codec import CODECS
from coopsim.comms.codecs.detections import SharesDetections
from coopsim.errors import CodecError, MissingDependencyError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.taxonomy import ObjectClass
from coopsim.types import Detections, Mask, PoseEstimate

ORIGIN = (0.0, 0.0)
"""Latitude and longitude of the world frame's origin, degrees. It is nobody's: scenarios are no places."""

_DEGREE_M = 111_319.49
"""On the equator, in either direction: pi / 180 of WGS 84's larger radius."""

_LARGEST_M, _LARGEST_SIZE_M = 1310.0, 25.4
_FARTHEST_M = np.array([180 * _DEGREE_M, 90 * _DEGREE_M, 8000.0])
_NS_PER_MS = 1_000_000
_LATEST_MS = 2**42 - 1
_PROTOCOL, _CPM, _OBJECTS = 2, 14, 5
_LONGEST = 2**15

_CLASSES: dict[ObjectClass, tuple[str, Any]] = {
    ObjectClass.CAR: ("vehicleSubClass", 5),  # passengerCar
    ObjectClass.VAN: ("vehicleSubClass", 7),  # lightTruck
    ObjectClass.TRUCK: ("vehicleSubClass", 8),  # heavyTruck
    ObjectClass.BUS: ("vehicleSubClass", 6),  # bus
    ObjectClass.MOTORCYCLE: ("vruSubClass", ("motorcyclist", "motorcycle")),
    ObjectClass.BICYCLE: ("vruSubClass", ("bicyclistAndLightVruVehicle", "bicyclist")),
    ObjectClass.SCOOTER: ("vruSubClass", ("bicyclistAndLightVruVehicle", "e-scooter")),
    ObjectClass.CHILD: ("vruSubClass", ("pedestrian", "ordinary-pedestrian")),
    ObjectClass.PEDESTRIAN: ("vruSubClass", ("pedestrian", "ordinary-pedestrian")),
}
_LABELS = {asn1: label for label, asn1 in _CLASSES.items()}


@dataclass(frozen=True, slots=True, eq=False)
class CollectivePerception:
    """What a station perceives, and when and where it was.

    Attributes:
        station_id: in 0..2^32 - 1.
        captured_ns: since the episode's start.
        position: (3,) m, of the station in the world frame.
        objects: as seen from there, in axes that are parallel to the world's.
        velocity: (N, 2) m/s of the objects, NaN where unknown; None: of none.
    """

    station_id: int
    captured_ns: int
    position: Floats
    objects: Detections = field(default_factory=Detections.empty)
    velocity: Floats | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen(self.position, (3,), np.float64, "position"))
        if self.velocity is not None:
            velocity = frozen(self.velocity, (len(self.objects), 2), np.float64, "velocity")
            object.__setattr__(self, "velocity", velocity)


@CODECS.register("cpm")
class CpmCodec(SharesDetections[CollectivePerception]):
    """Unaligned PER of `CollectivePerceptionMessage`, by asn1tools (the extra `etsi`).

    Management container (time, position) and perceived objects: position, heading, dimensions, class and its
    confidence, and velocity where it is known. Accuracies are sent as unavailable, covariances and embeddings are not
    sent. Where the standard says "n if at most n units and more than n - 1", the middle is decoded. Children become
    pedestrians: the standard does not tell them apart.

    Decoded are at most 255 objects, from at most 32,768 bytes. Objects without a heading, dimensions, or a class that
    coopsim has, are left out; messages with parts that the subset has not are refused.
    """

    CENTER_ERROR_M = 0.005 + 1e-9
    SIZE_ERROR_M = 0.05 + 1e-9
    YAW_ERROR_RAD = float(np.radians(0.05)) + 1e-9
    SCORE_ERROR = 0.005
    """0.01 for scores below 0.005, which come back as 0.01."""
    VELOCITY_ERROR_MPS = 0.005 + 1e-9
    POSITION_ERROR_M = 0.5e-7 * _DEGREE_M + 1e-6
    """Of the station, along x, y and z."""
    TIME_ERROR_NS = _NS_PER_MS // 2

    limit_bytes = 32 * 2**20
    most_objects = 255

    def __init__(self) -> None:
        _messages()  # what is missing is said now, not at the first message

    def in_range(self, found: Detections) -> Mask:
        return _in_range(found, _LARGEST_M)

    def share(self, found: Detections, sender: str, time_ns: int, pose: PoseEstimate) -> CollectivePerception:
        """The station's id is the CRC-32 of the sender's name."""
        turned = found.transform(SE3.from_xyz_yaw(np.zeros(3), float(pose.xyz_yaw[3])))
        return CollectivePerception(zlib.crc32(sender.encode()), time_ns, pose.xyz_yaw[:3], turned)

    def shared(self, content: CollectivePerception, pose: PoseEstimate) -> Detections:
        return content.objects.transform(SE3.from_xyz_yaw(np.zeros(3), -float(pose.xyz_yaw[3])))

    def encode(self, content: CollectivePerception) -> bytes:
        _require_sendable(content)
        messages = _messages()
        objects = _asn1_objects(content)
        container = {"numberOfPerceivedObjects": len(objects), "perceivedObjects": objects}
        data = messages.encode("PerceivedObjectContainer", container)
        message = {
            "header": {"protocolVersion": _PROTOCOL, "messageId": _CPM, "stationId": content.station_id},
            "payload": {
                "managementContainer": {
                    "referenceTime": round(content.captured_ns / _NS_PER_MS),
                    "referencePosition": _asn1_position(content.position),
                },
                "cpmContainers": [{"containerId": _OBJECTS, "containerData": data}],
            },
        }
        return bytes(messages.encode("CollectivePerceptionMessage", message))

    def decode(self, payload: bytes) -> CollectivePerception:
        if len(payload) > _LONGEST:
            raise CodecError(f"a collective perception message has at most {_LONGEST} bytes, got {len(payload)}")
        message = _decoded("CollectivePerceptionMessage", payload)
        header, body = message["header"], message["payload"]
        if (header["protocolVersion"], header["messageId"]) != (_PROTOCOL, _CPM):
            raise CodecError(f"a collective perception message has protocol 2 and id 14, got {header}")
        management = body["managementContainer"]
        data = [each["containerData"] for each in body["cpmContainers"] if each["containerId"] == _OBJECTS]
        found = [each for part in data for each in _decoded("PerceivedObjectContainer", part)["perceivedObjects"]]
        if len(found) > self.most_objects:
            raise CodecError(f"a collective perception message has at most 255 objects, got {len(found)}")
        objects, velocity = _objects(found)
        captured_ns = management["referenceTime"] * _NS_PER_MS
        where = _position(management["referencePosition"])
        _require_on_earth(where)
        return CollectivePerception(header["stationId"], captured_ns, where, objects, velocity)


def _in_range(found: Detections, largest_m: float) -> Mask:
    boxes = found.boxes
    # In the plane by the distance, so that it is in range whatever the heading of the axes.
    good: Mask = np.hypot(boxes.center[:, 0], boxes.center[:, 1]) <= largest_m
    good &= (np.abs(boxes.center[:, 2]) <= largest_m) & np.isfinite(boxes.yaw)
    good &= ((boxes.size > 0) & (boxes.size <= _LARGEST_SIZE_M)).all(axis=1)
    good &= (found.score >= 0) & (found.score <= 1) & (found.label >= 0) & (found.label < len(_CLASSES))
    return good


def _require_sendable(content: CollectivePerception) -> None:
    good = _in_range(content.objects, _LARGEST_M + 1e-3)  # a millimetre for the rounding of turned axes
    if not good.all():
        raise CodecError(
            f"object {int(np.argmin(good))} cannot be sent: accepted are centres within {_LARGEST_M} m, sizes in "
            f"(0, {_LARGEST_SIZE_M}] m and scores in [0, 1]"
        )
    if len(good) > CpmCodec.most_objects:
        raise CodecError(f"a collective perception message has at most 255 objects, got {len(good)}")
    if not (0 <= content.station_id < 2**32 and 0 <= content.captured_ns <= _LATEST_MS * _NS_PER_MS):
        raise CodecError(f"station {content.station_id} at {content.captured_ns} ns is out of ETSI's range")
    _require_on_earth(content.position)
    if content.velocity is not None and np.abs(content.velocity[np.isfinite(content.velocity)]).max(initial=0) > 163.8:
        raise CodecError("velocities must be within 163.8 m/s")


def _require_on_earth(position: Floats) -> None:
    if not ((np.abs(position) <= _FARTHEST_M).all() and position[2] >= -1000):
        raise CodecError(f"a station is on earth, from 1 km below to 8 km above the sea, got {position.tolist()} m")


def _units(values: Floats, unit: float) -> list[Any]:
    """How often a unit fits into values, as the standard rounds: n if at most n units and more than n - 1."""
    # What is a whole number but for rounding stays that number.
    whole: list[Any] = np.ceil(values / unit - 1e-9).astype(np.int64).tolist()
    return whole


def _asn1_position(position: Floats) -> dict[str, Any]:
    east, north = (position[:2] / _DEGREE_M + ORIGIN[::-1]) * 1e7
    return {
        "latitude": round(north),
        "longitude": round(east),
        "positionConfidenceEllipse": {
            "semiMajorConfidence": 4095,
            "semiMinorConfidence": 4095,
            "semiMajorOrientation": 3601,
        },
        "altitude": {"altitudeValue": round(position[2] * 100), "altitudeConfidence": "unavailable"},
    }


def _position(asn1: Mapping[str, Any]) -> Floats:
    east, north = asn1["longitude"] * 1e-7 - ORIGIN[1], asn1["latitude"] * 1e-7 - ORIGIN[0]
    return np.array([east * _DEGREE_M, north * _DEGREE_M, asn1["altitude"]["altitudeValue"] / 100])


def _asn1_objects(content: CollectivePerception) -> list[dict[str, Any]]:
    """asn1tools wants an object as a dict of dicts; only that, nothing is computed object by object."""
    found = content.objects
    centers, sizes = _units(found.boxes.center, 0.01), _units(np.maximum(found.boxes.size, 0.05), 0.1)
    angles = _units(np.degrees(found.boxes.yaw) % 360, 0.1)
    percents = np.clip(np.rint(found.score * 100), 1, 100).astype(np.int64).tolist()
    asn1: list[dict[str, Any]] = [
        {
            "objectId": number,
            "measurementDeltaTime": 0,
            "position": dict(
                zip(
                    ("xCoordinate", "yCoordinate", "zCoordinate"),
                    ({"value": value, "confidence": 4096} for value in center),
                    strict=True,
                )
            ),
            "angles": {"zAngle": {"value": angle % 3600, "confidence": 127}},
            "objectDimensionX": {"value": size[0], "confidence": 32},
            "objectDimensionY": {"value": size[1], "confidence": 32},
            "objectDimensionZ": {"value": size[2], "confidence": 32},
            "classification": [{"objectClass": _CLASSES[ObjectClass(label)], "confidence": percent}],
        }
        for number, (center, size, angle, percent, label) in enumerate(
            zip(centers, sizes, angles, percents, found.label.tolist(), strict=True)
        )
    ]
    if content.velocity is not None:
        known = np.asarray(np.isfinite(content.velocity).all(axis=1))
        speeds = _units(np.where(known[:, None], content.velocity, 0.0), 0.01)
        for number in np.flatnonzero(known):
            x, y = ({"value": value, "confidence": 127} for value in speeds[number])
            asn1[number]["velocity"] = ("cartesianVelocity", {"xVelocity": x, "yVelocity": y})
    return asn1


_UNREAD = ("acceleration", "zAngularVelocity", "lowerTriangularCorrelationMatrices", "mapPosition")


def _objects(asn1: list[dict[str, Any]]) -> tuple[Detections, Floats | None]:
    """Those objects that have all that a detection needs, and their velocities if any has one."""
    if unread := sorted({name for each in asn1 for name in _UNREAD if name in each}):
        raise CodecError(f"the objects have {', '.join(unread)}, which coopsim does not read")
    whole = [row for each in asn1 if (row := _row(each)) is not None]
    rows = np.array(whole, dtype=np.float64).reshape(-1, 11)
    boxes = Boxes3D(
        (rows[:, :3] - 0.5) * 0.01, (rows[:, 3:6] - 0.5) * 0.1, wrap_angle(np.radians((rows[:, 6] - 0.5) * 0.1))
    )
    found = Detections(boxes, rows[:, 7] / 100, rows[:, 8].astype(np.int64))
    velocity = (rows[:, 9:] - 0.5) * 0.01
    return found, None if np.isnan(velocity).all() else velocity


def _row(asn1: Mapping[str, Any]) -> list[float] | None:
    """Eleven numbers in the standard's units: x, y, z, l, w, h, heading, percent, our label, vx, vy.

    Velocities are NaN where there is no Cartesian one; None if something else is missing.
    """
    try:
        center = [asn1["position"][f"{axis}Coordinate"]["value"] for axis in "xyz"]
        size = [asn1[f"objectDimension{axis}"]["value"] for axis in "XYZ"]
        angle = asn1["angles"]["zAngle"]["value"]
        best = max(asn1["classification"], key=lambda each: each["confidence"] % 101)
        label = _LABELS[best["objectClass"]]
    except KeyError:
        return None
    percent = best["confidence"]
    if max(map(abs, center)) > 131_070 or max(size) > 254 or angle >= 3600 or percent > 100:
        return None
    return [*center, *size, angle, percent, label, *_speed(asn1.get("velocity"))]


def _speed(asn1: tuple[str, Any] | None) -> list[float]:
    if asn1 is None or asn1[0] != "cartesianVelocity":
        return [np.nan, np.nan]
    speed = [asn1[1][f"{axis}Velocity"]["value"] for axis in "xy"]
    return [np.nan, np.nan] if max(map(abs, speed)) > 16_381 else speed


def _decoded(name: str, data: bytes) -> Any:
    """What stands in the bytes of one ASN.1 type; raises `CodecError` if they are not exactly that.

    What was decoded is encoded again, because asn1tools does not tell how many bytes it has read.
    """
    messages = _messages()
    try:
        decoded = messages.decode(name, data)
        again = messages.encode(name, decoded)
    except Exception as error:  # whatever asn1tools runs into on bytes that are none: it names no common class
        raise CodecError(f"{len(data)} bytes are no {name}: {error}") from error
    if again != data:
        raise CodecError(f"{len(data)} bytes are not what coopsim reads of a {name}")
    return decoded


@cache
def _messages() -> Any:
    """The compiled module; raises `MissingDependencyError` without asn1tools."""
    try:
        import asn1tools
    except ImportError as error:
        raise MissingDependencyError("the codec 'cpm' needs asn1tools: pip install 'coopsim[etsi]'") from error
    module = resources.files(__package__).joinpath("cpm.asn").read_text(encoding="utf-8")
    return asn1tools.compile_string(module, "uper")
