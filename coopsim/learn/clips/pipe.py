"""Objects through a pipe between processes: arrays and tensors travel as they lie in memory, outside the pickle."""

from __future__ import annotations

import contextlib
import io
import pickle
import struct
from collections.abc import Callable
from typing import IO, Any

import numpy as np
import torch
from torch import Tensor

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

_LENGTH = struct.Struct("<Q")


def send(outlet: IO[bytes], value: Any) -> None:
    """Write an object to an unbuffered pipe: the number of its parts, their lengths, its pickle, and its arrays.

    Raises:
        BrokenPipeError: nobody reads any more.
    """
    arrays: list[pickle.PickleBuffer] = []
    content = io.BytesIO()
    _Pickler(content, 5, buffer_callback=arrays.append).dump(value)
    parts = [content.getbuffer(), *(each.raw() for each in arrays)]
    numbers = b"".join(map(_LENGTH.pack, [len(parts), *map(len, parts)]))
    for left in (memoryview(numbers), *parts):
        while left:  # an unbuffered file writes what fits
            left = left[outlet.write(left) :]


def receive(inlet: IO[bytes]) -> Any:
    """Return the next object from a pipe, whose arrays are writable.

    Raises:
        EOFError: the pipe has ended.
    """
    (count,) = _LENGTH.unpack(_read(inlet, _LENGTH.size))
    lengths = [_LENGTH.unpack(_read(inlet, _LENGTH.size))[0] for _ in range(count)]
    content, *arrays = [_read(inlet, length) for length in lengths]
    return pickle.loads(content, buffers=arrays)


class _Pickler(pickle.Pickler):
    """A pickler that takes tensors of the processor for arrays."""

    def reducer_override(self, value: Any) -> tuple[Callable[..., Any], tuple[Any, ...]] | Any:
        if isinstance(value, Tensor):
            return torch.from_numpy, (value.numpy(),)
        return NotImplemented


def widen(pipe: IO[bytes]) -> None:
    """Let a pipe hold a megabyte where the system can: readers wake up less often, and stop their process less."""
    with contextlib.suppress(AttributeError, OSError):  # Linux alone has it, and may refuse
        fcntl.fcntl(pipe.fileno(), fcntl.F_SETPIPE_SZ, 2**20)


def _read(inlet: IO[bytes], length: int) -> memoryview:
    content = np.empty(length, np.uint8).data  # which nobody fills first
    left = content
    while left:
        count = inlet.readinto(left)  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        left = left[count:]
    return content
