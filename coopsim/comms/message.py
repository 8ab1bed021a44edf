"""Codecs: the only way from content to bytes and back, and so the only place where bytes are counted.

A message on the air is an envelope (who, when, where, and a checksum) around a payload, whose layout is its codec's.
All numbers are little-endian.
"""

from __future__ import annotations

import struct
import zlib
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from coopsim.embedding import directions
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.taxonomy import CLASS_NAMES
from coopsim.types import Detections, Message, PoseEstimate

_ENVELOPE = struct.Struct("<BBq4dI")
"""Lengths of the sender's and the codec's name, capture time (ns), pose, length of the payload."""

_COVARIANCE = struct.Struct("<6f")
"""Of x, y and heading, the upper triangle row by row; between names and payload, where the sender states one."""

_CHECKSUM = struct.Struct("<I")
"""CRC-32 (ISO 3309, as in Ethernet) of everything after it."""

_COUNT = struct.Struct("<H")
_MOST_ROWS = 0xFFFF

T = TypeVar("T")


class Codec(ABC, Generic[T]):
    """One kind of content to payload bytes and back."""

    @abstractmethod
    def encode(self, content: T) -> bytes:
        """The payload for `content`."""

    @abstractmethod
    def decode(self, payload: bytes) -> T:
        """What `encode` was given, to the codec's precision; raises `CodecError` on anything else."""


def pack_rows(rows: NDArray[np.void], what: str) -> bytes:
    """The payload of structured rows: two bytes for their number, then the rows; `CodecError` if they are too many."""
    if len(rows) > _MOST_ROWS:
        raise CodecError(f"one message carries at most {_MOST_ROWS} {what}, got {len(rows)}")
    return _COUNT.pack(len(rows)) + rows.tobytes()


def unpack_rows(payload: bytes, row: np.dtype[np.void], what: str) -> tuple[NDArray[np.void], bytes]:
    """The rows that `pack_rows` was given, and what follows them; raises `CodecError` if it is too short."""
    count = _COUNT.unpack_from(payload)[0] if len(payload) >= _COUNT.size else 0
    end = _COUNT.size + count * row.itemsize
    if len(payload) < end:
        raise CodecError(f"{len(payload)} bytes are not a whole number of {what}")
    return np.frombuffer(payload, dtype=row, count=count, offset=_COUNT.size), payload[end:]


class DetectionsCodec(Codec[Detections]):
    """Boxes (seven float32), score (float32) and label (one byte): 33 bytes an object, 2 for their number.

    Where any of them has an embedding, 2 bytes follow for the width, and 2 for each element of each object: the
    embedding at length 1 as float16, zeros for none. Covariances are not sent.
    """

    _ROW = np.dtype([("box", "<f4", (7,)), ("score", "<f4"), ("label", "u1")])
    _WIDEST = 4096  # receivers keep tables of embeddings: nobody else shall decide how large

    def encode(self, content: Detections) -> bytes:
        rows = np.empty(len(content), dtype=self._ROW)
        rows["box"], rows["score"], rows["label"] = content.boxes.array, content.score, content.label
        return pack_rows(rows, "detections") + self._encode_embeddings(content)

    def decode(self, payload: bytes) -> Detections:
        rows, rest = unpack_rows(payload, self._ROW, "detections")
        if len(rows) and int(rows["label"].max()) >= len(CLASS_NAMES):
            raise CodecError(f"detection label {int(rows['label'].max())} is not in 0..{len(CLASS_NAMES) - 1}")
        embedding = self._decode_embeddings(rest, len(rows))
        return Detections(Boxes3D.from_array(rows["box"]), rows["score"], rows["label"], embedding=embedding)

    def _encode_embeddings(self, content: Detections) -> bytes:
        if content.embedding is None:
            return b""
        unit, present = directions(content.embedding)
        if not present.any():
            return b""
        if unit.shape[1] > self._WIDEST:
            raise CodecError(f"an embedding has at most {self._WIDEST} elements, got {unit.shape[1]}")
        return struct.pack("<H", unit.shape[1]) + unit.astype("<f2").tobytes()

    def _decode_embeddings(self, block: bytes, count: int) -> Floats | None:
        if not block:
            return None
        width = struct.unpack_from("<H", block)[0] if len(block) >= 2 else 0
        if not (count and 1 <= width <= self._WIDEST and len(block) == 2 + 2 * count * width):
            raise CodecError(f"{len(block)} bytes after {count} detections are not an embedding for each")
        values = np.frombuffer(block, dtype="<f2", offset=2).reshape(count, width).astype(np.float64)
        if not np.isfinite(values).all():
            raise CodecError("the embeddings of detections must be finite")
        return values


_DETECTIONS = DetectionsCodec()


def encode_message(message: Message) -> bytes:
    """The message as it goes on the air; its length is what it costs."""
    sender, codec = message.sender.encode(), message.codec.encode()
    if max(len(sender), len(codec)) > 0xFF:
        raise CodecError(f"names of sender and codec take at most 255 bytes, got {message.sender!r}")
    head = _ENVELOPE.pack(len(sender), len(codec), message.captured_ns, *message.pose.xyz_yaw, len(message.payload))
    content = b"".join((head, sender, codec, _pack_covariance(message.pose.covariance), message.payload))
    return _CHECKSUM.pack(zlib.crc32(content)) + content


def decode_message(wire: bytes) -> Message:
    """The message that `encode_message` was given; raises `CodecError` on anything else."""
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
    if not np.isfinite(pose).all():
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


def payload_of(message: Message, codec: str) -> bytes:
    """The payload of a message of that codec; raises `CodecError` if it carries something else."""
    if message.codec != codec:
        raise CodecError(f"the message from {message.sender} carries {message.codec!r}, not {codec!r}")
    return message.payload


def decode_detections(message: Message) -> Detections:
    """The detections in a message, in the sender's base frame at the time of capture.

    Raises:
        CodecError: the payload is broken, or the message carries something else.
    """
    return _DETECTIONS.decode(payload_of(message, "detections"))
