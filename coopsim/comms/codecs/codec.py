"""What a codec is: the only way from content to payload bytes and back, and so what decides what content costs.

Bytes come from anywhere. `decode` raises `CodecError` on all that `encode` does not make, before it allocates more than
the codec's declared limit. All numbers are little-endian.
"""

from __future__ import annotations

import struct
import zlib
from abc import ABC, abstractmethod
from functools import cache
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import CodecError
from coopsim.support.registry import Registry

_COUNT = struct.Struct("<H")
MOST_ROWS = 0xFFFF
"""The most objects in one message: what two bytes count."""

T = TypeVar("T")


class Codec(ABC, Generic[T]):
    """One kind of content to payload bytes and back.

    Attributes:
        content: the kind of content; who understands one codec of a kind understands all.
        limit_bytes: the most that `decode` allocates, whatever a payload holds or announces.
    """

    content: ClassVar[str]
    limit_bytes: ClassVar[int]

    @abstractmethod
    def encode(self, content: T) -> bytes:
        """The payload for `content`; raises `CodecError` on what the codec cannot carry within its error bounds."""

    @abstractmethod
    def decode(self, payload: bytes) -> T:
        """What `encode` was given, to the codec's precision; raises `CodecError` on anything else."""


CODECS: Registry[type[Codec[Any]]] = Registry("codec")
"""Codec classes by the name that messages carry. Any of their objects decodes the payloads of all: what an object is
given says only how it encodes."""


@cache
def decoder(name: str) -> Codec[Any]:
    """An object of the codec called `name`; raises `UnknownNameError` when there is none."""
    return CODECS.get(name)()


def codecs_of(content: str) -> tuple[str, ...]:
    """The names of all codecs for one kind of content."""
    return tuple(name for name in CODECS if CODECS.get(name).content == content)


def pack_rows(rows: NDArray[np.void], what: str) -> bytes:
    """The payload of structured rows: two bytes for their number, then the rows; `CodecError` if they are too many."""
    if len(rows) > MOST_ROWS:
        raise CodecError(f"one message carries at most {MOST_ROWS} {what}, got {len(rows)}")
    return _COUNT.pack(len(rows)) + rows.tobytes()


def unpack_rows(payload: bytes, row: np.dtype[np.void], what: str) -> tuple[NDArray[np.void], bytes]:
    """The rows that `pack_rows` was given, and what follows them; raises `CodecError` if it is too short."""
    count = _COUNT.unpack_from(payload)[0] if len(payload) >= _COUNT.size else 0
    end = _COUNT.size + count * row.itemsize
    if len(payload) < end:
        raise CodecError(f"{len(payload)} bytes are not a whole number of {what}")
    return np.frombuffer(payload, dtype=row, count=count, offset=_COUNT.size), payload[end:]


def unpack_head(payload: bytes, head: struct.Struct, what: str) -> tuple[Any, ...]:
    """The fixed beginning of a payload; raises `CodecError` if it is too short."""
    if len(payload) < head.size:
        raise CodecError(f"{what} begin with {head.size} bytes, got {len(payload)}")
    return head.unpack_from(payload)


def inflate(block: bytes, size: int, what: str) -> bytes:
    """Exactly `size` bytes from a zlib stream (RFC 1950); never inflates more, so a bomb does no harm.

    Raises:
        CodecError: the block is no such stream, is of another size, or something follows it.
    """
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(block, size + 1)
    except zlib.error as error:
        raise CodecError(f"{what} are no zlib stream: {error}") from error
    if len(content) != size or not stream.eof or stream.unused_data:
        raise CodecError(f"{what} do not inflate to the {size} bytes that are announced")
    return content
