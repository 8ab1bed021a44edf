"""Memory that two processes share."""

from __future__ import annotations

import contextlib
import mmap
import os
import tempfile

_FIRST_BYTES = 2**16


class Arena:
    """Memory shared with another process, which grows. Only one side writes; only the writer makes it grow.

    It is a file without a name: the system frees it when both processes are gone, in whatever way they went.

    Args:
        descriptor: of the file; the other process has it by inheritance.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._memory = mmap.mmap(descriptor, os.fstat(descriptor).st_size)
        self.view = memoryview(self._memory)

    @classmethod
    def new(cls) -> Arena:
        """Make an arena of its own file."""
        if hasattr(os, "memfd_create"):  # Linux; it is not bound by the size of /dev/shm, which is small in containers
            descriptor = os.memfd_create("coopsim")
        else:
            with tempfile.TemporaryFile() as file:
                descriptor = os.dup(file.fileno())
        os.ftruncate(descriptor, _FIRST_BYTES)
        return cls(descriptor)

    def reserve(self, size: int) -> None:
        """Have at least `size` bytes: the writer makes the file longer, the reader maps what there is now."""
        if size <= len(self.view):
            return
        if size > os.fstat(self.descriptor).st_size:
            os.ftruncate(self.descriptor, 1 << (size - 1).bit_length())
        self._memory = mmap.mmap(self.descriptor, os.fstat(self.descriptor).st_size)  # the old one ends with its views
        self.view = memoryview(self._memory)

    def close(self) -> None:
        """Let go of the file."""
        if self.descriptor >= 0:
            with contextlib.suppress(BufferError):  # an interrupted reader may have views of it; it ends with them
                self.view.release()
                self._memory.close()
            os.close(self.descriptor)
            self.descriptor = -1
