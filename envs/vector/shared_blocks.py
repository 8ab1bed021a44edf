"""Memory shared by a worker and the calling process, in blocks."""

from __future__ import annotations

import mmap
import os
import pickle
import tempfile
import weakref
from collections import defaultdict, deque
from collections.abc import Iterable
from typing import Any

import numpy as np

Block = tuple[int, int]
"""Offset in the file, and size of the content in bytes."""

_LARGE_BYTES = 2**14
"""Size from which an array has a block of its own; smaller ones are copied with the rest of their content."""


class SharedBlocks:
    """A file without a name, in memory, of which one process writes blocks and another one reads them in place.

    Large arrays of what is read are views of blocks. The reader says when the last view of a block is gone, and only
    then the writer uses it again; so the arrays are the reader's own without having been copied. The system frees
    the file when both processes are gone, in whatever way they went.
    """

    def __init__(self, file: int) -> None:
        self.file = file
        self._end = 0
        self._maps: dict[int, mmap.mmap] = {}
        self._free: defaultdict[int, list[int]] = defaultdict(list)
        self._released: deque[Block] = deque()

    @classmethod
    def new(cls) -> SharedBlocks:
        """Make a file."""
        if hasattr(os, "memfd_create"):  # Linux; it is not bound by the size of /dev/shm, which is small in containers
            return cls(os.memfd_create("coopsim"))
        with tempfile.TemporaryFile() as file:
            return cls(os.dup(file.fileno()))

    def write(self, content: object) -> list[Block]:
        """Write any content that can be pickled; return the blocks to `read`."""
        large: list[memoryview] = []

        def small(buffer: pickle.PickleBuffer) -> bool:
            raw = buffer.raw()
            if raw.nbytes < _LARGE_BYTES:
                return True
            large.append(raw)
            return False

        pickled = memoryview(pickle.dumps(content, protocol=5, buffer_callback=small))
        return [self._put(part) for part in (pickled, *large)]

    def reuse(self, blocks: Iterable[Block]) -> None:
        """Take blocks back that the reader has released."""
        for offset, size in blocks:
            self._free[_capacity(size)].append(offset)

    def read(self, blocks: list[Block]) -> Any:
        """Return the content; its large arrays are views, and release their blocks when they are gone."""
        pickled, *large = blocks
        offset, size = pickled
        with memoryview(self._map(offset, size)) as view:
            content = pickle.loads(view[:size], buffers=[self._array(*block) for block in large])
        self._released.append(pickled)
        return content

    def released(self) -> list[Block]:
        """Return the blocks that were released since the last call."""
        return [self._released.popleft() for _ in range(len(self._released))]

    def close(self) -> None:
        """Let go of the file; views stay valid."""
        self._maps.clear()
        if self.file >= 0:
            os.close(self.file)
        self.file = -1

    def _array(self, offset: int, size: int) -> np.ndarray[Any, Any]:
        array = np.frombuffer(self._map(offset, size), np.uint8, size)
        weakref.finalize(array, self._released.append, (offset, size)).atexit = False
        return array

    def _put(self, part: memoryview) -> Block:
        size = part.nbytes
        capacity = _capacity(size)
        if not self._free[capacity]:
            os.ftruncate(self.file, self._end + capacity)
            self._free[capacity].append(self._end)
            self._end += capacity
        offset = self._free[capacity].pop()
        self._map(offset, size)[:size] = part
        return offset, size

    def _map(self, offset: int, size: int) -> mmap.mmap:
        if offset not in self._maps:
            self._maps[offset] = mmap.mmap(self.file, _capacity(size), offset=offset)
        return self._maps[offset]


def _capacity(size: int) -> int:
    """Return the size of the block that holds `size` bytes: a power of two, so that blocks fit again."""
    return max(mmap.ALLOCATIONGRANULARITY, 1 << (size - 1).bit_length())
