"""Bytes between a policy's process and ours: plain data as parcels, which name no code, over pipes with time limits.

A parcel is the length of a header, the header, and the bytes of all arrays, end to end. The header is JSON, in which an
array is its type, its shape and the place of its first byte.
"""

from __future__ import annotations

import json
import math
import os
import select
import struct
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from coopsim.errors import InvalidValueError

_LENGTH = struct.Struct("<I")
_ARRAY = "array"
_KINDS = frozenset("biuf")


def pack_parcel(content: object) -> bytes:
    """Return plain data as bytes: dicts by text, lists, texts, numbers, None, bytes, and arrays of numbers."""
    heap: list[bytes] = []
    header = json.dumps(_plain(content, heap)).encode()
    return b"".join((_LENGTH.pack(len(header)), header, *heap))


def unpack_parcel(parcel: bytes) -> Any:
    """Return the content of a parcel; bytes come as arrays of uint8. Raises `InvalidValueError` for other bytes."""
    try:
        (length,) = _LENGTH.unpack_from(parcel)
        heap = memoryview(parcel)[_LENGTH.size + length :]
        return _read(json.loads(parcel[_LENGTH.size : _LENGTH.size + length]), heap)
    except (struct.error, ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
        raise InvalidValueError(f"the bytes are no parcel: {error}") from error


def _plain(value: Any, heap: list[bytes]) -> Any:
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {"dict": {key: _plain(part, heap) for key, part in value.items()}}
    if isinstance(value, (list, tuple)):
        return [_plain(part, heap) for part in value]
    if isinstance(value, bytes):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind in _KINDS:
        begin = sum(map(len, heap))
        heap.append(np.ascontiguousarray(value).tobytes())
        return {_ARRAY: [value.dtype.str, list(value.shape), begin]}
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise InvalidValueError(f"data between processes must be plain (dicts, lists, texts, numbers), got {value!r:.200}")


def _read(value: Any, heap: memoryview) -> Any:
    if isinstance(value, list):
        return [_read(part, heap) for part in value]
    if not isinstance(value, dict):
        return value
    if _ARRAY not in value:
        return {key: _read(part, heap) for key, part in value["dict"].items()}
    name, shape, begin = value[_ARRAY]
    dtype = np.dtype(str(name))
    if dtype.kind not in _KINDS or not all(type(each) is int and each >= 0 for each in (*shape, begin)):
        raise ValueError(f"an array of {name!r} and shape {shape!r} is none of numbers")
    count = math.prod(shape)
    if begin + count * dtype.itemsize > len(heap):
        raise ValueError("an array is longer than the bytes that came")
    return np.frombuffer(heap, dtype, count, begin).reshape(shape) if count else np.zeros(shape, dtype)


_BLOCK = struct.Struct("<q")
_MOST_BYTES = 2**30
_CHUNK_BYTES = 2**20


class Pipe:
    """The ends of two pipes, from (`reader`) and to (`writer`) another process; data are sent as blocks of bytes."""

    def __init__(self, reader: int, writer: int) -> None:
        self._reader, self._writer = reader, writer
        os.set_blocking(writer, False)

    def send(self, block: bytes, limit_s: float | None = None) -> None:
        """Send a block. Raises `TimeoutError` after `limit_s`, and `BrokenPipeError` if the other process is gone."""
        end_s = _end_s(limit_s)
        left = memoryview(_BLOCK.pack(len(block)) + block)
        while left:
            _wait(self._writer, select.POLLOUT, end_s)
            left = left[os.write(self._writer, left[:_CHUNK_BYTES]) :]

    def receive(self, limit_s: float | None = None) -> bytes:
        """Wait for a block, and return it.

        Raises:
            TimeoutError: it has not come within `limit_s`.
            EOFError: the other process is gone.
            ValueError: the other process announces a block longer than 1 GiB.
        """
        end_s = _end_s(limit_s)
        (length,) = _BLOCK.unpack(self._read(_BLOCK.size, end_s))
        if not 0 <= length <= _MOST_BYTES:
            raise ValueError(f"a block has at most {_MOST_BYTES} bytes, announced were {length}")
        return self._read(length, end_s)

    def _read(self, count: int, end_s: float | None) -> bytes:
        read = bytearray()
        while len(read) < count:
            _wait(self._reader, select.POLLIN, end_s)
            part = os.read(self._reader, min(count - len(read), _CHUNK_BYTES))
            if not part:
                raise EOFError
            read += part
        return bytes(read)


def _end_s(limit_s: float | None) -> float | None:
    return None if limit_s is None else time.monotonic() + limit_s


def _wait(descriptor: int, event: int, end_s: float | None) -> None:
    poll = select.poll()
    poll.register(descriptor, event)
    left_ms = None if end_s is None else max(0.0, end_s - time.monotonic()) * 1000
    if not poll.poll(left_ms):
        raise TimeoutError
