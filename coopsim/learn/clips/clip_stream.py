"""Clips in order, made ahead by other processes while the caller trains."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import subprocess
import threading
import weakref
from collections.abc import Iterator
from typing import IO, Self

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_store import ClipSource
from coopsim.learn.clips.clip_worker import LENGTH, Made
from coopsim.support.checks import require_count
from coopsim.support.processes import cause_of_end, start_python

_PROGRAM = "from coopsim.learn.clips.clip_worker import serve; serve()"


class ClipStream(Iterator[Clip]):
    """The clips of a source from a first index on, without an end; the same for any number of workers.

    Worker processes begin anew and end with this process, however that ends: they find no reader for their next clip.
    Close the stream, or use it in a `with` statement, to end them at once.

    Args:
        source: of the clips. With workers it must be picklable, and its class importable.
        first_index: of the first clip.
        workers: number of processes that make them; 0: this one makes each when it is asked for.
        ahead: clips that wait for the caller, of each worker, besides the one that it is making.

    Raises:
        InvalidValueError: a number is not accepted, or the source cannot be pickled.
    """

    def __init__(self, source: ClipSource, first_index: int = 0, workers: int = 1, ahead: int = 2) -> None:
        require_count(0, first_index=first_index, workers=workers)
        require_count(1, ahead=ahead)
        self._source, self._next, self._first = source, int(first_index), int(first_index)
        self._workers: list[_Worker] = []
        self._end = weakref.finalize(self, _end_all, self._workers)  # also when the interpreter exits
        try:
            for k in range(workers):
                self._workers.append(_Worker(source, first_index + k, workers, ahead))
        except BaseException:
            self.close()
            raise

    @property
    def index(self) -> int:
        """Index of the next clip."""
        return self._next

    def __next__(self) -> Clip:
        """Return the next clip, once it is there.

        Raises:
            CoopsimError: the source raised it, or another error, whose traceback it then has; or a worker was killed.
                The stream is closed.
            StopIteration: the stream was closed.
        """
        if not self._end.alive:
            raise StopIteration
        if not self._workers:
            made: Made = self._source.clip(self._next)
        else:
            made = self._workers[(self._next - self._first) % len(self._workers)].take()
        if not isinstance(made, Clip):
            self.close()
            raise made if isinstance(made, CoopsimError) else CoopsimError(f"clip {self._next} failed:\n{made}")
        self._next += 1
        return made

    def close(self) -> None:
        """End the workers; may be called again."""
        self._end()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class _Worker:
    """A process that makes every `stride`-th clip, and a thread that fetches what it has made."""

    def __init__(self, source: ClipSource, index: int, stride: int, ahead: int) -> None:
        try:
            order = pickle.dumps((source, index, stride))
        except Exception as error:
            raise InvalidValueError(f"source must be picklable to be given to workers: {error}") from error
        self._owner = os.getpid()
        self._ready: queue.Queue[Made] = queue.Queue(ahead)
        self._ended = threading.Event()
        self._process = start_python(_PROGRAM)
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the thread finds out why
            self._process.stdin.write(order)
            self._process.stdin.close()
        threading.Thread(target=_fetch, args=(self._process, self._ready, self._ended), daemon=True).start()

    def take(self) -> Made:
        """Return the next clip or error, once it is there."""
        return self._ready.get()

    def end(self) -> None:
        """Kill the process, unless this is a fork of the one whose worker it is."""
        if os.getpid() != self._owner:
            return
        self._ended.set()
        self._process.kill()
        self._process.wait()


def _end_all(workers: list[_Worker]) -> None:
    for worker in workers:
        worker.end()


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
    head = outlet.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    content = outlet.read(length)
    return None if len(content) < length else pickle.loads(content)
