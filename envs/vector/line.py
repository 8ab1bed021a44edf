"""Messages between two processes: short headers by pipes, contents by shared memory."""

from __future__ import annotations

import os
import pickle
import select
import struct
from typing import Any

from coopsim.envs.vector.arena import Arena
from coopsim.envs.vector.contents import arrays_from, parts_of, put_together, taken_apart

_HEADER = struct.Struct("<qqqq")
"""Where in the memory the pickled skeleton, the small arrays and the large ones begin, and where they end."""

_ATOMIC = 4096 - 4096 % _HEADER.size
"""Bytes of headers that a pipe takes as a whole."""


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
        self._held = b""
        self._ready = select.poll()
        self._ready.register(reader, select.POLLIN)

    def send(self, content: object, *, hold: bool = False) -> None:
        """Send any content that can be pickled; it is copied.

        Args:
            content: the content.
            hold: let the other end sleep until more is sent.

        Raises:
            BrokenPipeError: the other end is gone.
        """
        skeleton, arrays = taken_apart(content)
        shapes, small, large = parts_of(arrays)
        pickled = pickle.dumps((skeleton, shapes), protocol=5)
        start = self._filled
        small_at = start + len(pickled)
        large_at = small_at + len(small)
        end = large_at + sum(map(len, large))
        self._outbox.reserve(end)
        self._put(pickled)
        self._put(small)
        for part in large:
            self._put(part)
        self._held += _HEADER.pack(start, small_at, large_at, end)
        if not hold or len(self._held) >= _ATOMIC:
            os.write(self._writer, self._held)
            self._held = b""

    def wait(self) -> None:
        """Wait until `receive` has something to read, or the other end is gone; may be interrupted and called again."""
        self._ready.poll()

    def receive(self) -> Any:
        """Wait for the next content, and return it; its arrays are the caller's own.

        Raises:
            EOFError: the other end is gone.
        """
        header = os.read(self._reader, _HEADER.size)
        if len(header) < _HEADER.size:
            raise EOFError
        start, small_at, large_at, end = _HEADER.unpack(header)
        self._filled = 0
        self._inbox.reserve(end)
        view = self._inbox.view
        skeleton, shapes = pickle.loads(view[start:small_at])
        return put_together(skeleton, arrays_from(shapes, view[small_at:large_at], view[large_at:end]))

    def close(self) -> None:
        """Let go of the shared memory."""
        self._inbox.close()
        self._outbox.close()

    def _put(self, part: bytes | memoryview) -> None:
        end = self._filled + len(part)
        self._outbox.view[self._filled : end] = part
        self._filled = end
