"""ETSI's Collective Perception Message (TS 103 324) in its own encoding: the subset of `docs/reference/codecs.md`.

Bits are asn1tools'; here are the conversions between arrays and ASN.1 values in the standard's units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from coopsim.comms.codecs.asn1 import DEGREE_M, PROTOCOL, compiled, decode_exactly, station_id
from coopsim.comms.codecs.codec import CODECS, encode_prefix
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.arrays import frozen
from coopsim.types import Detections, Mask, PoseEstimate
from coopsim.types.taxonomy import CLASS_NAMES, ObjectClass

_CLASSES: dict[ObjectClass, tuple[str, Any]] = {
    ObjectClass.CAR: ("vehicleSubClass", 5),  # passengerCar
    ObjectClass.VAN: ("vehicleSubClass", 7),  # lightTruck
    ObjectClass.TRUCK: ("vehicleSubClass", 8),  # heavyTruck
    ObjectClass.BUS: ("vehicleSubClass", 6),  # bus
    ObjectClass.MOTORCYCLE: ("vruSubClass", ("motorcyclist", "motorcycle")),
    ObjectClass.BICYCLE: ("vruSubClass", ("bicyclistAndLightVruVehicle", "bicyclist")),
    ObjectClass.SCOOTER: ("vruSubClass", ("bicyclistAndLightVruVehicle", "e-scooter")),
    # The same for both; decoded as the second.
    ObjectClass.CHILD: ("vruSubClass", ("pedestrian", "ordinary-pedestrian")),
    ObjectClass.PEDESTRIAN: ("vruSubClass", ("pedestrian", "ordinary-pedestrian")),
}
_LABELS = {asn1: label for label, asn1 in _CLASSES.items()}


def _units(values: Floats, unit: float) -> list[Any]:
    """Return values in whole units, rounded up as the standard does: n for at most n units and more than n - 1."""
    # Values that are whole numbers except for rounding errors stay those numbers.
    whole: list[Any] = np.ceil(values / unit - 1e-9).astype(np.int64).tolist()
    return whole


def asn1_position(position: Floats) -> dict[str, Any]:
    """Convert a position (3,) m to a `ReferencePosition`."""
    east, north = position[:2] / DEGREE_M * 1e7
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


def position_of(asn1: Mapping[str, Any]) -> Floats:
    """Convert a `ReferencePosition` to a position (3,) m, the inverse of `asn1_position`."""
    east, north = asn1["longitude"] * 1e-7, asn1["latitude"] * 1e-7
    return np.array([east * DEGREE_M, north * DEGREE_M, asn1["altitude"]["altitudeValue"] / 100])


_FASTEST_MPS = 163.8


def asn1_objects(found: Detections) -> list[dict[str, Any]]:
    """Convert objects to a list of `PerceivedObject`. Velocities that the standard cannot express are left out.

    asn1tools needs an object as a dict of dicts; only that is made object by object.
    """
    centers, sizes = _units(found.boxes.center, 0.01), _units(np.maximum(found.boxes.size, 0.05), 0.1)
    angles = _units(np.degrees(found.boxes.yaw) % 360, 0.1)
    percents = np.clip(np.rint(found.score * 100), 1, 100).astype(np.int64).tolist()
    asn1: list[dict[str, Any]] = [
        {
            "objectId": number,
            "measurementDeltaTime": 0,
            "position": {
                f"{axis}Coordinate": {"value": value, "confidence": 4096}
                for axis, value in zip("xyz", center, strict=True)
            },
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
    if found.velocity is not None:
        known = np.asarray((np.abs(found.velocity) <= _FASTEST_MPS).all(axis=1))
        speeds = _units(np.where(known[:, None], found.velocity, 0.0), 0.01)
        for number in np.flatnonzero(known):
            x, y = ({"value": value, "confidence": 127} for value in speeds[number])
            asn1[number]["velocity"] = ("cartesianVelocity", {"xVelocity": x, "yVelocity": y})
    return asn1


_UNREAD = ("acceleration", "zAngularVelocity", "lowerTriangularCorrelationMatrices", "mapPosition")


def objects_of(asn1: list[dict[str, Any]]) -> Detections:
    """Return objects that have all fields of a detection; raise `CodecError` for fields that are not read."""
    if unread := sorted({name for each in asn1 for name in _UNREAD if name in each}):
        raise CodecError(f"the objects have {', '.join(unread)}, which coopsim does not read")
    complete = [row for each in asn1 if (row := _row(each)) is not None]
    rows = np.array(complete, dtype=np.float64).reshape(-1, 11)
    boxes = Boxes3D(
        (rows[:, :3] - 0.5) * 0.01, (rows[:, 3:6] - 0.5) * 0.1, wrap_angle(np.radians((rows[:, 6] - 0.5) * 0.1))
    )
    velocity = (rows[:, 9:] - 0.5) * 0.01
    stated = None if np.isnan(velocity).all() else velocity
    return Detections(boxes, rows[:, 7] / 100, rows[:, 8].astype(np.int64), velocity=stated)


def _row(asn1: Mapping[str, Any]) -> list[float] | None:
    """Return x, y, z, l, w, h, heading, percent, coopsim's label, vx, vy, in the standard's units.

    Velocities are NaN without a Cartesian one. Return None if any other field is missing.
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


@cache
def messages() -> Any:
    """Return the compiled ASN.1 module; raise `MissingDependencyError` without asn1tools."""
    return compiled("cpm.asn", "the codec 'cpm'")


_LARGEST_M, _LARGEST_SIZE_M = 1310.0, 25.4
_FARTHEST_M = np.array([180 * DEGREE_M, 90 * DEGREE_M, 8000.0])
_NS_PER_MS = 1_000_000
_LATEST_MS = 2**42 - 1
_CPM, _OBJECTS = 14, 5


@dataclass(frozen=True, slots=True, eq=False)
class CollectivePerception:
    """Content of a Collective Perception Message: a station's objects, position and capture time.

    Attributes:
        station_id: in 0..2^32 - 1.
        captured_ns: capture time since the episode's start.
        position: (3,) m, of the station in the world frame.
        objects: relative to the station, in axes parallel to the world's.
    """

    station_id: int
    captured_ns: int
    position: Floats
    objects: Detections = field(default_factory=Detections.empty)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen(self.position, (3,), np.float64, "position"))


@CODECS.register("cpm")
class CpmCodec(SharesDetections[CollectivePerception]):
    """Unaligned PER of `CollectivePerceptionMessage`, by asn1tools (the extra `etsi`).

    Management container (time, position) and perceived objects: position, heading, dimensions, class and its
    confidence, and velocity where known and within 163.8 m/s. Accuracies are sent as unavailable; covariances and
    embeddings are not sent.
    Where the standard rounds up ("n if at most n units and more than n - 1"), decoding returns the middle. Children
    become pedestrians: the standard does not distinguish them.

    A message has at most 255 objects and 32,768 bytes. Decoding drops objects without a heading, dimensions, or a class
    of coopsim's, and refuses messages with parts outside of the subset.
    """

    CENTER_ERROR_M = 0.005 + 1e-9
    SIZE_ERROR_M = 0.05 + 1e-9
    YAW_ERROR_RAD = float(np.radians(0.05)) + 1e-9
    SCORE_ERROR = 0.005
    """Up to 0.01 for scores below 0.005, which are decoded as 0.01."""
    VELOCITY_ERROR_MPS = 0.005 + 1e-9
    POSITION_ERROR_M = 0.5e-7 * DEGREE_M + 1e-6
    """Of the station, along x, y and z."""
    TIME_ERROR_NS = _NS_PER_MS // 2

    limit_bytes = 32 * 2**20
    most_objects = 255

    def __init__(self) -> None:
        messages()  # raises if asn1tools is missing, before the first message

    def in_range(self, found: Detections) -> Mask:
        return _in_range(found, _LARGEST_M)

    def content_of(self, found: Detections, sender: str, time_ns: int, pose: PoseEstimate) -> CollectivePerception:
        """Return the message's content; the station's id is the CRC-32 of the sender's name."""
        turned = found.transform(SE3.from_xyz_yaw(np.zeros(3), float(pose.xyz_yaw[3])))
        return CollectivePerception(station_id(sender), time_ns, pose.xyz_yaw[:3], turned)

    def detections_in(self, content: CollectivePerception, pose: PoseEstimate) -> Detections:
        return content.objects.transform(SE3.from_xyz_yaw(np.zeros(3), -float(pose.xyz_yaw[3])))

    def encode(self, content: CollectivePerception) -> bytes:
        _require_sendable(content)
        objects = asn1_objects(content.objects)
        container = {"numberOfPerceivedObjects": len(objects), "perceivedObjects": objects}
        data = messages().encode("PerceivedObjectContainer", container)
        message = {
            "header": {"protocolVersion": PROTOCOL, "messageId": _CPM, "stationId": content.station_id},
            "payload": {
                "managementContainer": {
                    "referenceTime": round(content.captured_ns / _NS_PER_MS),
                    "referencePosition": asn1_position(content.position),
                },
                "cpmContainers": [{"containerId": _OBJECTS, "containerData": data}],
            },
        }
        return bytes(messages().encode("CollectivePerceptionMessage", message))

    def encode_within(self, content: CollectivePerception, budget_bytes: int) -> bytes:
        """Return the message with as many leading objects as a budget holds: put the most useful first."""

        def first(count: int) -> CollectivePerception:
            return replace(content, objects=content.objects[:count])

        return encode_prefix(lambda count: self.encode(first(count)), len(content.objects), budget_bytes)

    def decode(self, payload: bytes) -> CollectivePerception:
        message = decode_exactly(messages(), "CollectivePerceptionMessage", payload)
        header, body = message["header"], message["payload"]
        if (header["protocolVersion"], header["messageId"]) != (PROTOCOL, _CPM):
            raise CodecError(f"a collective perception message has protocol 2 and id 14, got {header}")
        management = body["managementContainer"]
        data = [each["containerData"] for each in body["cpmContainers"] if each["containerId"] == _OBJECTS]
        parts = [decode_exactly(messages(), "PerceivedObjectContainer", part)["perceivedObjects"] for part in data]
        found = [each for part in parts for each in part]
        if len(found) > self.most_objects:
            raise CodecError(f"a collective perception message has at most 255 objects, got {len(found)}")
        captured_ns = management["referenceTime"] * _NS_PER_MS
        position = position_of(management["referencePosition"])
        require_on_earth(position)
        return CollectivePerception(header["stationId"], captured_ns, position, objects_of(found))


def _in_range(found: Detections, largest_m: float) -> Mask:
    boxes = found.boxes
    # By distance in the plane, so that the range does not depend on the heading of the axes.
    with np.errstate(over="ignore"):
        good: Mask = np.hypot(boxes.center[:, 0], boxes.center[:, 1]) <= largest_m
    good &= (np.abs(boxes.center[:, 2]) <= largest_m) & np.isfinite(boxes.yaw)
    good &= ((boxes.size > 0) & (boxes.size <= _LARGEST_SIZE_M)).all(axis=1)
    good &= (found.score >= 0) & (found.score <= 1) & (found.label >= 0) & (found.label < len(CLASS_NAMES))
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
    require_on_earth(content.position)


def require_on_earth(position: Floats) -> None:
    """Raise `CodecError` for a position (3,) m that ETSI's reference positions do not hold."""
    if not ((np.abs(position) <= _FARTHEST_M).all() and position[2] >= -1000):
        raise CodecError(
            f"a station must be on earth, from 1 km below to 8 km above the sea, got {position.tolist()} m"
        )
