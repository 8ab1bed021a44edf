"""Contents of messages as a skeleton and arrays, which costs a third of the time of pickling the arrays one by one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_DTYPES: list[np.dtype[Any]] = [np.dtype(code) for code in "?bBhHiIqQefd"]
_CODES = {dtype: code for code, dtype in enumerate(_DTYPES)}

_NODES = (dict, list, tuple, np.ndarray)

_LARGE_BYTES = 2**14
"""Size from which an array has memory of its own: who keeps a small array keeps all small ones of a message."""

_ALIGNED = 8


class _Slot:
    """Stands for an array in a skeleton."""

    def __reduce__(self) -> str:
        return "_SLOT"


_SLOT = _Slot()

Shape = tuple[int, tuple[int, ...], int]
"""Code of an array's type, its shape and its size in bytes."""


def taken_apart(content: Any) -> tuple[Any, list[Array]]:
    """Return a content with slots in the place of its arrays, and the arrays, in order and C-contiguous.

    Arrays are looked for in dicts, lists and tuples, named ones too. Those of other than plain numbers stay.
    """
    arrays: list[Array] = []
    return _stripped(content, arrays), arrays


def put_together(skeleton: Any, arrays: Iterator[Array]) -> Any:
    """Return the content again; dicts and lists of the skeleton are changed."""
    return _filled(skeleton, arrays)


def parts_of(arrays: list[Array]) -> tuple[list[Shape], bytes, list[memoryview]]:
    """Return what `arrays_from` must know, the small arrays end to end and aligned, and the bytes of each large one."""
    shapes: list[Shape] = []
    small: list[Any] = []
    large: list[memoryview] = []
    for array in arrays:
        size = array.nbytes
        shapes.append((_CODES[array.dtype], array.shape, size))
        if size >= _LARGE_BYTES:
            large.append(array.reshape(-1).view(np.uint8).data)
        elif size:
            small.append(array)
            if size % _ALIGNED:
                small.append(bytes(-size % _ALIGNED))
    return shapes, b"".join(small), large


def arrays_from(shapes: list[Shape], small: memoryview, large: memoryview) -> Iterator[Array]:
    """Yield arrays of their own memory.

    Args:
        shapes: of all.
        small: the small ones, end to end.
        large: the large ones, end to end.
    """
    own, at, large_at = bytearray(small), 0, 0
    for code, shape, size in shapes:
        if not size:
            yield np.empty(shape, _DTYPES[code])
        elif size < _LARGE_BYTES:
            yield np.ndarray(shape, _DTYPES[code], own, at)
            at += size + -size % _ALIGNED
        else:
            yield np.ndarray(shape, _DTYPES[code], bytearray(large[large_at : large_at + size]))
            large_at += size


def _stripped(content: Any, arrays: list[Array]) -> Any:
    kind = type(content)
    if kind is dict:
        stripped = {}
        for key, value in content.items():
            if type(value) is np.ndarray and value.dtype in _CODES and value.flags.c_contiguous:  # as most are
                arrays.append(value)
                stripped[key] = _SLOT
            elif isinstance(value, _NODES):
                stripped[key] = _stripped(value, arrays)
            else:
                stripped[key] = value
        return stripped
    if kind is np.ndarray and content.dtype in _CODES:
        arrays.append(np.asarray(content, order="C"))
        return _SLOT
    if kind is list:
        return [_stripped(value, arrays) for value in content]
    if isinstance(content, tuple):
        return _tuple_like(kind, [_stripped(value, arrays) for value in content])
    return content


def _filled(skeleton: Any, arrays: Iterator[Array]) -> Any:
    if skeleton is _SLOT:
        return next(arrays)
    kind = type(skeleton)
    if kind is dict:
        for key, value in skeleton.items():
            if value is _SLOT:
                skeleton[key] = next(arrays)
            elif isinstance(value, _NODES):
                skeleton[key] = _filled(value, arrays)
        return skeleton
    if kind is list:
        return [_filled(value, arrays) for value in skeleton]
    if isinstance(skeleton, tuple):
        return _tuple_like(kind, [_filled(value, arrays) for value in skeleton])
    return skeleton


def _tuple_like(kind: type, parts: list[Any]) -> Any:
    """Return parts as a named tuple of that kind, or as a plain tuple."""
    return kind(*parts) if hasattr(kind, "_fields") else tuple(parts)
