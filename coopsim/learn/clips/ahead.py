"""Clips made ahead by other processes while the caller trains.

A worker reads the source and its share of the indices from its standard input, and writes clips to its standard output,
each as its length in eight bytes and its pickle. A pipe holds little, so a worker is never further ahead than its
reader lets it.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import struct
import subprocess
import sys
import threading
import traceback
import weakref
from collections.abc import Iterator
from typing import IO, BinaryIO, Self

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.learn.clips.clip import Clip, ClipSource
from coopsim.support.checks import require_count
from coopsim.support.processes import cause_of_end, start_python
from coopsim.support.threads import limit_threads

_PROGRAM = "from coopsim.learn.clips.ahead import serve; serve()"
_LENGTH = struct.Struct("<Q")

Made = Clip | CoopsimError | str
"""A clip; or why there is none and no later one: coopsim's own error, or the traceback of another."""


class ClipsAhead:
    """Clips of a source, made ahead by worker processes for sequential access.

    Workers end with this process, however that ends: they find no reader for their next clip. Close it, or use it in a
    `with` statement, to end them at once.

    Args:
        source: picklable source, whose class can be imported.
        workers: number of processes.
        ahead: finished clips that each worker keeps ready, besides the one that it is making.
    """

    def __init__(self, source: ClipSource, workers: int = 1, ahead: int = 2) -> None:
        require_count(1, workers=workers, ahead=ahead)
        self._source, self._count, self._ahead = source, workers, ahead
        self._first, self._next = 0, -1
        self._workers: list[_Worker] = []
        weakref.finalize(self, _end_all, self._workers)  # also when the interpreter exits

    def clip(self, index: int) -> Clip:
        """Return a clip, without delay if it follows the one before and is made.

        Raises:
            CoopsimError: the source raised it, or another error, whose traceback it then has; or a worker was killed.
            InvalidValueError: the source cannot be pickled.
        """
        if index != self._next:
            self._start(index)
        made = self._workers[(index - self._first) % self._count].ready.get()
        if not isinstance(made, Clip):
            self.close()
            raise made if isinstance(made, CoopsimError) else CoopsimError(f"clip {index} failed:\n{made}")
        self._next = index + 1
        return made

    def close(self) -> None:
        """End the workers; may be called again."""
        _end_all(self._workers)
        self._next = -1

    def _start(self, index: int) -> None:
        self.close()
        self._first = index
        try:
            for k in range(self._count):
                self._workers.append(_Worker(self._source, index + k, self._count, self._ahead))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class _Worker:
    """A process that makes every `stride`-th clip, and a thread that fetches them into a queue."""

    def __init__(self, source: ClipSource, index: int, stride: int, ahead: int) -> None:
        try:
            order = pickle.dumps((source, index, stride))
        except Exception as error:
            raise InvalidValueError(f"source must be picklable to be given to workers: {error}") from error
        self._owner = os.getpid()
        self.ready: queue.Queue[Made] = queue.Queue(ahead)
        self._ended = threading.Event()
        self._process = start_python(_PROGRAM)
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the thread finds out why
            self._process.stdin.write(order)
            self._process.stdin.close()
        threading.Thread(target=_fetch, args=(self._process, self.ready, self._ended), daemon=True).start()

    def end(self) -> None:
        """Kill the process, unless this is a fork of the one whose worker it is."""
        if os.getpid() != self._owner:
            return
        self._ended.set()
        self._process.kill()
        self._process.wait()


def _end_all(workers: list[_Worker]) -> None:
    while workers:
        workers.pop().end()


def _fetch(process: subprocess.Popen[bytes], ready: queue.Queue[Made], ended: threading.Event) -> None:
    """Put into the queue what a worker sends, until it sends no more."""
    assert process.stdout is not None
    with process.stdout as outlet:
        while not ended.is_set():
            made = _received(outlet)
            if made is None:
                made = f"its worker ended: {cause_of_end(process.wait())}"
            while not ended.is_set():
                with contextlib.suppress(queue.Full):
                    ready.put(made, timeout=0.2)
                    break
            if not isinstance(made, Clip):
                return


def _received(outlet: IO[bytes]) -> Made | None:
    """Return what a worker has sent, or None if it ended before."""
    head = outlet.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    content = outlet.read(length)
    return None if len(content) < length else pickle.loads(content)


def serve() -> None:
    """Make clips until the reader is gone or an error is raised: the program of a worker."""
    outlet = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a source prints must not get among the clips
    limit_threads(1)
    try:
        for made in _made(sys.stdin.buffer):
            content = pickle.dumps(made, protocol=5)
            for part in (_LENGTH.pack(len(content)), content):
                left = memoryview(part)
                while left:  # an unbuffered file writes what fits
                    left = left[outlet.write(left) :]
    except (BrokenPipeError, EOFError):
        os._exit(0)


def _made(inlet: BinaryIO) -> Iterator[Made]:
    """Yield clips without an end, or an error last."""
    try:
        source, index, stride = pickle.load(inlet)
    except EOFError:
        raise
    except Exception:  # a source that can be pickled, but not made again
        yield traceback.format_exc()
        return
    while True:
        made = make(source, index)
        yield made
        if not isinstance(made, Clip):
            return
        index += stride


def make(source: ClipSource, index: int) -> Made:
    """Return a clip of a source, or its error."""
    try:
        clip: Clip = source.clip(index)
    except CoopsimError as error:
        return error
    except Exception:  # of a user's source
        return traceback.format_exc()
    return clip
