"""Bytes to and from another process, each with a time limit, so that a process that hangs is noticed."""

from __future__ import annotations

import os
import select
import struct
import time

_LENGTH = struct.Struct("<q")
_MOST_BYTES = 2**30
_CHUNK_BYTES = 2**20


class Pipe:
    """One end of two pipes to another process. What is sent is taken apart into blocks of bytes.

    Args:
        reader: descriptor of the pipe from the other process.
        writer: descriptor of the pipe to it.
    """

    def __init__(self, reader: int, writer: int) -> None:
        self._reader, self._writer = reader, writer
        os.set_blocking(writer, False)

    def send(self, block: bytes, limit_s: float | None = None) -> None:
        """Send a block.

        Raises:
            TimeoutError: the other process has not taken it within `limit_s`.
            BrokenPipeError: it is gone.
        """
        end_s = _end_s(limit_s)
        left = memoryview(_LENGTH.pack(len(block)) + block)
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
        (length,) = _LENGTH.unpack(self._read(_LENGTH.size, end_s))
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
