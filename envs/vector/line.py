"""Messages between two processes: short headers by pipes, contents by shared memory."""

from __future__ import annotations

import os
import pickle
import struct
from typing import Any

from coopsim.envs.vector.arena import Arena

_HEADER = struct.Struct("<qqqq")
"""Start of the pickle, its length, number of buffers that follow it, and the end of the last."""

_LENGTH = struct.Struct("<q")

_LARGE = 2**15
"""Bytes of a content from which its arrays stay outside the pickle: they are copied once less, but each costs time."""


class Line:
    """One end of a line between two processes that take turns: orders go one way, then all replies come back.

    What is received proves that the other end has read all that was sent before; so each turn begins at the start of
    the shared memory.

    Args:
        reader: pipe of headers to us.
        writer: pipe of headers to the other end.
        inbox: memory that the other end writes.
        outbox: memory that we write.
    """

    def __init__(self, reader: int, writer: int, inbox: Arena, outbox: Arena) -> None:
        self._reader, self._writer, self._inbox, self._outbox = reader, writer, inbox, outbox
        self._filled = 0
        self._large = False  # the last content was

    def send(self, content: object) -> None:
        """Send any content that can be pickled; it is copied.

        Raises:
            BrokenPipeError: the other end is gone.
        """
        buffers: list[pickle.PickleBuffer] = []
        outside = buffers.append if self._large else None
        pickled = pickle.dumps(content, protocol=5, buffer_callback=outside)
        raw = [buffer.raw() for buffer in buffers]
        end = self._filled + len(pickled) + sum(_LENGTH.size + each.nbytes for each in raw)
        self._large = end - self._filled > _LARGE
        self._outbox.reserve(end)
        header = _HEADER.pack(self._filled, len(pickled), len(raw), end)
        self._put(pickled)
        for each in raw:
            self._put(_LENGTH.pack(each.nbytes))
            self._put(each)
        os.write(self._writer, header)  # shorter than a pipe's atomic write

    def receive(self) -> Any:
        """Wait for the next content, and return it; its arrays are the caller's own.

        Raises:
            EOFError: the other end is gone.
        """
        header = os.read(self._reader, _HEADER.size)
        if len(header) < _HEADER.size:
            raise EOFError
        start, length, count, end = _HEADER.unpack(header)
        self._filled = 0
        self._inbox.reserve(end)
        view = self._inbox.view
        buffers = []
        at = start + length
        for _ in range(count):
            (size,) = _LENGTH.unpack_from(view, at)
            at += _LENGTH.size
            buffers.append(bytearray(view[at : at + size]))
            at += size
        return pickle.loads(view[start : start + length], buffers=buffers)

    def close(self) -> None:
        """Let go of the shared memory."""
        self._inbox.close()
        self._outbox.close()

    def _put(self, part: bytes | memoryview) -> None:
        end = self._filled + len(part)
        self._outbox.view[self._filled : end] = part
        self._filled = end
