"""Messages as bytes on the air: the only place where bytes are counted.

A message is an envelope (sender, capture time, pose, checksum) around a payload, whose layout is its codec's
(`coopsim.comms.codecs`). All numbers are little-endian.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import Any

import numpy as np

from coopsim.comms.codecs.codec import CODECS, decoder
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections, FeatureMap, InstanceQueries, Message, PointCloud, PoseEstimate
from coopsim.types.track_estimates import TrackEstimates

_ENVELOPE = struct.Struct("<BBq4dI")
"""Lengths of the sender's and the codec's name, capture time (ns), pose, length of the payload."""

_COVARIANCE = struct.Struct("<6f")
"""The upper triangle of the pose's covariance (x, y, heading), row by row; between names and payload, if stated."""

_CHECKSUM = struct.Struct("<I")
"""CRC-32 (ISO 3309, as in Ethernet) of everything after it."""


def encode_message(message: Message) -> bytes:
    """Return the message as bytes on the air; their number is its cost."""
    sender, codec = message.sender.encode(), message.codec.encode()
    if max(len(sender), len(codec)) > 0xFF:
        raise CodecError(f"names of sender and codec take at most 255 bytes, got {message.sender!r}")
    head = _ENVELOPE.pack(len(sender), len(codec), message.captured_ns, *message.pose.xyz_yaw, len(message.payload))
    content = b"".join((head, sender, codec, _pack_covariance(message.pose.covariance), message.payload))
    return _CHECKSUM.pack(zlib.crc32(content)) + content


def decode_message(wire: bytes) -> Message:
    """Return the message of some bytes; raises `CodecError` if `encode_message` does not make such bytes."""
    least = _CHECKSUM.size + _ENVELOPE.size
    if len(wire) < least:
        raise CodecError(f"a message has at least {least} bytes, got {len(wire)}")
    if zlib.crc32(memoryview(wire)[_CHECKSUM.size :]) != _CHECKSUM.unpack_from(wire)[0]:
        raise CodecError(f"the checksum is not that of the {len(wire)} bytes that came")
    sender_length, codec_length, captured_ns, *pose, payload_length = _ENVELOPE.unpack_from(wire, _CHECKSUM.size)
    names_end = least + sender_length + codec_length
    stated = len(wire) == names_end + _COVARIANCE.size + payload_length
    if not stated and len(wire) != names_end + payload_length:
        raise CodecError(f"the envelope announces another length than the {len(wire)} bytes that came")
    try:
        sender = wire[least : least + sender_length].decode()
        codec = wire[least + sender_length : names_end].decode()
    except UnicodeDecodeError as error:
        raise CodecError(f"the names in the envelope are not UTF-8: {error}") from error
    if not sender:
        raise CodecError("the envelope names no sender")
    if not all(map(math.isfinite, pose)):
        raise CodecError(f"the sender's pose must be finite, got {pose}")
    covariance = _unpack_covariance(_COVARIANCE.unpack_from(wire, names_end)) if stated else None
    payload = wire[len(wire) - payload_length :]
    return Message(sender, captured_ns, PoseEstimate(np.array(pose), covariance), payload, codec)


def _pack_covariance(covariance: Floats | None) -> bytes:
    if covariance is None:
        return b""
    most = float(np.finfo(np.float32).max)
    return _COVARIANCE.pack(*np.clip(covariance[np.triu_indices(3)], -most, most))


def _unpack_covariance(upper: tuple[float, ...]) -> Floats:
    covariance = np.zeros((3, 3))
    covariance[np.triu_indices(3)] = upper
    covariance = np.triu(covariance) + np.triu(covariance, 1).T
    if not np.isfinite(covariance).all() or np.diagonal(covariance).min() < 0:
        raise CodecError(f"the covariance of the sender's pose must be finite and not negative, got {upper}")
    return covariance


def decode_detections(message: Message) -> Detections:
    """Return the detections in a message, by any codec, in the sender's base frame at capture time.

    Raises:
        CodecError: the payload is broken, or the content is another one; so do all functions below.
    """
    codec: SharesDetections[Any] = _codec_of(message, "detections")
    return codec.detections_in(codec.decode(message.payload), message.pose)


def decode_tracks(message: Message) -> TrackEstimates:
    """Return the tracks in a message, in the sender's base frame at capture time."""
    tracks: TrackEstimates = _codec_of(message, "tracks").decode(message.payload)
    return tracks


def decode_points(message: Message) -> PointCloud:
    """Return the points in a message, in the sender's base frame at capture time."""
    cloud: PointCloud = _codec_of(message, "points").decode(message.payload)
    return cloud


def decode_features(message: Message) -> FeatureMap:
    """Return the feature map in a message, on a grid in the sender's base frame at capture time."""
    features: FeatureMap = _codec_of(message, "features").decode(message.payload)
    return features


def decode_queries(message: Message) -> InstanceQueries:
    """Return the queries in a message, in the sender's base frame at capture time."""
    queries: InstanceQueries = _codec_of(message, "queries").decode(message.payload)
    return queries


def _codec_of(message: Message, content: str) -> Any:
    """Return the codec of a message, which must be one for that content."""
    if message.codec not in CODECS or decoder(message.codec).content != content:
        raise CodecError(f"the message from {message.sender} carries {message.codec!r}, not {content!r}")
    return decoder(message.codec)
