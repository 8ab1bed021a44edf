"""ETSI's Collective Perception Message (TS 103 324) in its own encoding: the subset of `docs/reference/codecs.md`.

Scenarios have no place on earth: the world frame is taken as east, north and up around latitude 0, longitude 0, where a
degree of either has the same length. Episodes begin with ETSI's time, at 2004-01-01T00:00:00Z.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace

import numpy as np

from coopsim.comms.codecs.codec import CODECS, encode_prefix
from coopsim.comms.codecs.cpm_asn1 import (
    DEGREE_M,
    asn1_objects,
    asn1_position,
    decode_exactly,
    messages,
    objects_of,
    position_of,
)
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.errors import CodecError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.arrays import frozen
from coopsim.types import Detections, Mask, PoseEstimate
from coopsim.types.taxonomy import CLASS_NAMES

_LARGEST_M, _LARGEST_SIZE_M = 1310.0, 25.4
_FARTHEST_M = np.array([180 * DEGREE_M, 90 * DEGREE_M, 8000.0])
_NS_PER_MS = 1_000_000
_LATEST_MS = 2**42 - 1
_PROTOCOL, _CPM, _OBJECTS = 2, 14, 5
_LONGEST = 2**15


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
        return CollectivePerception(zlib.crc32(sender.encode()), time_ns, pose.xyz_yaw[:3], turned)

    def detections_in(self, content: CollectivePerception, pose: PoseEstimate) -> Detections:
        return content.objects.transform(SE3.from_xyz_yaw(np.zeros(3), -float(pose.xyz_yaw[3])))

    def encode(self, content: CollectivePerception) -> bytes:
        _require_sendable(content)
        objects = asn1_objects(content.objects)
        container = {"numberOfPerceivedObjects": len(objects), "perceivedObjects": objects}
        data = messages().encode("PerceivedObjectContainer", container)
        message = {
            "header": {"protocolVersion": _PROTOCOL, "messageId": _CPM, "stationId": content.station_id},
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
        if len(payload) > _LONGEST:
            raise CodecError(f"a collective perception message has at most {_LONGEST} bytes, got {len(payload)}")
        message = decode_exactly("CollectivePerceptionMessage", payload)
        header, body = message["header"], message["payload"]
        if (header["protocolVersion"], header["messageId"]) != (_PROTOCOL, _CPM):
            raise CodecError(f"a collective perception message has protocol 2 and id 14, got {header}")
        management = body["managementContainer"]
        data = [each["containerData"] for each in body["cpmContainers"] if each["containerId"] == _OBJECTS]
        parts = [decode_exactly("PerceivedObjectContainer", part)["perceivedObjects"] for part in data]
        found = [each for part in parts for each in part]
        if len(found) > self.most_objects:
            raise CodecError(f"a collective perception message has at most 255 objects, got {len(found)}")
        captured_ns = management["referenceTime"] * _NS_PER_MS
        position = position_of(management["referencePosition"])
        _require_on_earth(position)
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
    _require_on_earth(content.position)


def _require_on_earth(position: Floats) -> None:
    if not ((np.abs(position) <= _FARTHEST_M).all() and position[2] >= -1000):
        raise CodecError(
            f"a station must be on earth, from 1 km below to 8 km above the sea, got {position.tolist()} m"
        )
