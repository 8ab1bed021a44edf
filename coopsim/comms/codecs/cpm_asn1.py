"""Conversion between arrays and ASN.1 values of a Collective Perception Message, in the standard's units."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from coopsim.errors import CodecError, MissingDependencyError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Detections
from coopsim.types.taxonomy import ObjectClass

DEGREE_M = 111_319.49
"""A degree on the equator, in either direction: pi / 180 of WGS 84's larger radius."""

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
    """Return the objects that have all fields of a detection, with their velocities if any has one.

    Raises:
        CodecError: an object has a field that coopsim does not read.
    """
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


def decode_exactly(name: str, data: bytes) -> Any:
    """Decode the bytes of one ASN.1 type.

    The content is encoded again for comparison, because asn1tools does not report how many bytes it has read.

    Raises:
        CodecError: the bytes are not exactly one value of the type.
    """
    module = messages()
    try:
        content = module.decode(name, data)
        encoded = module.encode(name, content)
    except Exception as error:  # asn1tools' errors on invalid bytes have no common class
        raise CodecError(f"{len(data)} bytes are no {name}: {error}") from error
    if encoded != data:
        raise CodecError(f"{len(data)} bytes are not what coopsim reads of a {name}")
    return content


@cache
def messages() -> Any:
    """Return the compiled ASN.1 module; raise `MissingDependencyError` without asn1tools."""
    try:
        import asn1tools
    except ImportError as error:
        raise MissingDependencyError("the codec 'cpm' needs asn1tools: pip install 'coopsim[etsi]'") from error
    text = resources.files(__package__).joinpath("cpm.asn").read_text(encoding="utf-8")
    return asn1tools.compile_string(text, "uper")
