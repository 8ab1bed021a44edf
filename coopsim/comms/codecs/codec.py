"""The codec interface: content to payload bytes and back, and nothing else decides what content costs.

Payloads come from other agents. `decode` raises `CodecError` on everything that `encode` does not make, before it
allocates more than the codec's declared limit. All numbers are little-endian.
"""

from __future__ import annotations

import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import CodecError, UnknownNameError
from coopsim.support.checks import require_choice
from coopsim.support.registry import Registry

_COUNT = struct.Struct("<H")
MOST_ROWS = 0xFFFF
"""The most objects in one message, which two bytes count."""

T = TypeVar("T")


class Codec(ABC, Generic[T]):
    """A way to write one kind of content as payload bytes, and to read it.

    A codec class can be made without arguments: its parameters say only how it encodes, and any object of the class
    decodes the payloads of all.

    Attributes:
        content: the kind of content. A receiver that understands one codec of a kind understands all of them.
        limit_bytes: the most memory that `decode` allocates, whatever a payload holds or announces.
    """

    content: ClassVar[str]
    limit_bytes: ClassVar[int]

    @abstractmethod
    def encode(self, content: T) -> bytes:
        """Return the payload.

        Raises:
            CodecError: the codec cannot carry the content within its error bounds.
        """

    @abstractmethod
    def decode(self, payload: bytes) -> T:
        """Return the content that was encoded, to the codec's precision.

        Raises:
            CodecError: `encode` does not make such a payload.
        """

    def encode_within(self, content: T, budget_bytes: int) -> bytes:
        """Return a payload of at most `budget_bytes`: all of the content, or its most useful part.

        Override it where a codec can leave something out. If not even empty content fits, the payload of empty content
        is returned: it still says where the sender is.

        Raises:
            CodecError: the codec cannot leave anything out, or cannot carry the content at all.
        """
        payload = self.encode(content)
        if len(payload) > budget_bytes:
            name = type(self).__name__
            raise CodecError(f"{name} cannot leave anything out of {len(payload)} bytes to keep within {budget_bytes}")
        return payload

    @property
    def divisible(self) -> bool:
        """Flag of a codec that can leave out the least useful part of its content, see `encode_within`."""
        return type(self).encode_within is not Codec.encode_within


CODECS: Registry[type[Codec[Any]]] = Registry("codec", home="coopsim.comms.codecs", group="coopsim.codecs")
"""Codec classes, by the name that messages carry. Installed packages add theirs through the entry-point group
`coopsim.codecs`."""


@cache
def decoder(name: str) -> Codec[Any]:
    """Return an object of the codec called `name`; raises `UnknownNameError` if there is none."""
    return CODECS.get(name)()


def codecs_of(content: str) -> tuple[str, ...]:
    """Return the names of all codecs for one kind of content."""
    return tuple(name for name in CODECS if CODECS.get(name).content == content)


def require_codec(name: str, content: str) -> None:
    """Raise `UnknownNameError` unless there is a codec called `name` for this kind of content."""
    where = f"for {content}: it carries {CODECS.get(name).content}" if name in CODECS else ""
    require_choice("codec", name, codecs_of(content), where)


def make_codec(spec: object, content: str) -> tuple[str, Codec[Any]]:
    """Make a codec by its spec, such as `sparse_features(most_cells=500, number=int8)`; return its name and the codec.

    Raises:
        UnknownNameError: there is no such codec for this kind of content, or no such parameter.
        InvalidValueError: the spec has another shape, or the value of a parameter is not accepted.
        MissingDependencyError: the codec needs a package that is not installed.
    """
    if not isinstance(spec, str):
        raise UnknownNameError("codec", spec, codecs_of(content))
    name, parameters = parse_spec("codec", spec)
    require_codec(name, content)
    return name, instantiate("codec", name, CODECS.get(name), parameters)


def encode_prefix(encode: Callable[[int], bytes], count: int, budget_bytes: int) -> bytes:
    """Return the payload of as many leading rows as a budget holds, by bisection; without rows if not even one fits.

    The length of `encode(N)`, the payload of the first N of `count` rows, grows with N.
    """
    whole = encode(count)
    if len(whole) <= budget_bytes or not count:
        return whole
    fits, least, most = encode(0), 1, count - 1
    while least <= most:
        middle = (least + most) // 2
        payload = encode(middle)
        if len(payload) <= budget_bytes:
            fits, least = payload, middle + 1
        else:
            most = middle - 1
    return fits


def pack_rows(rows: NDArray[np.void], what: str) -> bytes:
    """Return structured rows as bytes: two for their number, then the rows; raises `CodecError` for too many."""
    if len(rows) > MOST_ROWS:
        raise CodecError(f"one message carries at most {MOST_ROWS} {what}, got {len(rows)}")
    return _COUNT.pack(len(rows)) + rows.tobytes()


def unpack_rows(payload: bytes, row: np.dtype[np.void], what: str) -> tuple[NDArray[np.void], bytes]:
    """Return the rows written by `pack_rows`, and the bytes after them; raises `CodecError` if bytes are missing."""
    count = _COUNT.unpack_from(payload)[0] if len(payload) >= _COUNT.size else 0
    end = _COUNT.size + count * row.itemsize
    if len(payload) < end:
        raise CodecError(f"{len(payload)} bytes are not a whole number of {what}")
    return np.frombuffer(payload, dtype=row, count=count, offset=_COUNT.size), payload[end:]


def unpack_head(payload: bytes, head: struct.Struct, what: str) -> tuple[Any, ...]:
    """Return the fields of a payload's head; raises `CodecError` if the payload is shorter."""
    if len(payload) < head.size:
        raise CodecError(f"{what} begin with {head.size} bytes, got {len(payload)}")
    return head.unpack_from(payload)


def inflate(block: bytes, size: int, what: str) -> bytes:
    """Inflate a zlib stream (RFC 1950) of exactly `size` bytes; never inflates more, so a bomb does no harm.

    Raises `CodecError` for a block that is no zlib stream, has another size, or goes on after the stream.
    """
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(block, size + 1)
    except zlib.error as error:
        raise CodecError(f"{what} are no zlib stream: {error}") from error
    if len(content) != size or not stream.eof or stream.unused_data:
        raise CodecError(f"{what} do not inflate to the {size} bytes that are announced")
    return content
