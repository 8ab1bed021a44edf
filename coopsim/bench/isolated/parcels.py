"""Plain data as bytes that can be read from a process that is not trusted: nothing in them names code.

A parcel is the length of a header, the header, and the bytes of all arrays, end to end. The header is JSON, in which an
array is its type, its shape and the place of its first byte.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from coopsim.errors import InvalidValueError

_LENGTH = struct.Struct("<I")
_ARRAY = "array"
_KINDS = frozenset("biuf")


def pack_parcel(content: object) -> bytes:
    """Return plain data as bytes: dicts by text, lists, texts, numbers, None, bytes, and arrays of numbers.

    Raises:
        InvalidValueError: there is something else in it.
    """
    heap: list[bytes] = []
    header = json.dumps(_plain(content, heap)).encode()
    return b"".join((_LENGTH.pack(len(header)), header, *heap))


def unpack_parcel(parcel: bytes) -> Any:
    """Return the content of a parcel; bytes come as arrays of uint8.

    Raises:
        InvalidValueError: the bytes are no parcel.
    """
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
