"""Codecs: the only way from content to bytes and back, and so the only place where bytes are counted.

A message on the air is an envelope (who, when, where) around a payload, whose layout is its codec's.
All numbers are little-endian.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.taxonomy import CLASS_NAMES
from coopsim.types import Detections, Message, PoseEstimate

_ENVELOPE = struct.Struct("<BBq4dI")
"""Lengths of the sender's and the codec's name, capture time (ns), pose, length of the payload."""

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


def unpack_rows(payload: bytes, row: np.dtype[np.void], what: str) -> NDArray[np.void]:
    """The rows that `pack_rows` was given; raises `CodecError` unless the payload is exactly as long as it says."""
    if len(payload) < _COUNT.size or len(payload) != _COUNT.size + _COUNT.unpack_from(payload)[0] * row.itemsize:
        raise CodecError(f"{len(payload)} bytes are not a whole number of {what}")
    return np.frombuffer(payload, dtype=row, offset=_COUNT.size)


class DetectionsCodec(Codec[Detections]):
    """Boxes (seven float32), score (float32) and label (one byte): 33 bytes an object, 2 for their number.

    Covariances and embeddings are not sent.
    """

    _ROW = np.dtype([("box", "<f4", (7,)), ("score", "<f4"), ("label", "u1")])

    def encode(self, content: Detections) -> bytes:
        rows = np.empty(len(content), dtype=self._ROW)
        rows["box"], rows["score"], rows["label"] = content.boxes.array, content.score, content.label
        return pack_rows(rows, "detections")

    def decode(self, payload: bytes) -> Detections:
        rows = unpack_rows(payload, self._ROW, "detections")
        if len(rows) and int(rows["label"].max()) >= len(CLASS_NAMES):
            raise CodecError(f"detection label {int(rows['label'].max())} is not in 0..{len(CLASS_NAMES) - 1}")
        return Detections(Boxes3D.from_array(rows["box"]), rows["score"], rows["label"])


_DETECTIONS = DetectionsCodec()


def encode_message(message: Message) -> bytes:
    """The message as it goes on the air; its length is what it costs."""
    sender, codec = message.sender.encode(), message.codec.encode()
    if max(len(sender), len(codec)) > 0xFF:
        raise CodecError(f"names of sender and codec take at most 255 bytes, got {message.sender!r}")
    head = _ENVELOPE.pack(len(sender), len(codec), message.captured_ns, *message.pose.xyz_yaw, len(message.payload))
    return head + sender + codec + message.payload


def decode_message(wire: bytes) -> Message:
    """The message that `encode_message` was given; raises `CodecError` on anything else."""
    if len(wire) < _ENVELOPE.size:
        raise CodecError(f"a message has at least {_ENVELOPE.size} bytes, got {len(wire)}")
    sender_length, codec_length, captured_ns, *pose, payload_length = _ENVELOPE.unpack_from(wire)
    body = wire[_ENVELOPE.size :]
    if len(body) != sender_length + codec_length + payload_length:
        raise CodecError(f"the envelope announces another length than the {len(wire)} bytes that came")
    try:
        sender = body[:sender_length].decode()
        codec = body[sender_length : sender_length + codec_length].decode()
    except UnicodeDecodeError as error:
        raise CodecError(f"the names in the envelope are not UTF-8: {error}") from error
    if not np.isfinite(pose).all():
        raise CodecError(f"the sender's pose must be finite, got {pose}")
    payload = body[sender_length + codec_length :]
    return Message(sender, captured_ns, PoseEstimate(np.array(pose)), payload, codec)


def decode_detections(message: Message) -> Detections:
    """The detections in a message, in the sender's base frame at the time of capture.

    Raises:
        CodecError: the payload is broken, or the message carries something else.
    """
    if message.codec != "detections":
        raise CodecError(f"the message from {message.sender} carries {message.codec!r}, not 'detections'")
    return _DETECTIONS.decode(message.payload)
