"""Clips, or whole batches, made ahead by other processes while the caller trains.

A worker reads what it makes and its share of the numbers from its standard input, and writes what is made to its
standard output, see `coopsim.learn.clips.pipe`. A pipe holds little, so a worker is never further ahead than its reader
lets it.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import sys
import threading
import time
import traceback
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO, Protocol, Self

import cloudpickle

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.learn.clips.clip import Clip, ClipSource
from coopsim.learn.clips.pipe import receive, send, widen
from coopsim.support.checks import require_count
from coopsim.support.processes import cause_of_end, start_python
from coopsim.support.registrations import pack_registrations, register_packed
from coopsim.support.threads import limit_threads

_PATIENCE_S = 0.2
"""Time after which a thread that waits for its reader looks whether the worker is to end."""

_PROGRAM = "from coopsim.learn.clips.ahead import serve; serve()"


class Maker(Protocol):
    """Source of what workers make: a picklable object, whose class may be of the caller's script."""

    def make(self, first: int, stride: int) -> Iterator[Any]:
        """Yield without end what has the numbers first, first + stride, and so on."""


@dataclass(frozen=True)
class Failure:
    """The reason why a worker makes no more: coopsim's own error, or the traceback of another."""

    reason: CoopsimError | str

    def error(self, what: str) -> CoopsimError:
        """Return the error to raise where `what` was asked for."""
        return self.reason if isinstance(self.reason, CoopsimError) else CoopsimError(f"{what} failed:\n{self.reason}")


@dataclass(frozen=True)
class ClipMaker:
    """A maker of the clips of a source."""

    source: ClipSource

    def make(self, first: int, stride: int) -> Iterator[Clip]:
        while True:
            yield self.source.clip(first)
            first += stride


class Closing(ABC):
    """Something that a `with` statement closes."""

    @abstractmethod
    def close(self) -> None:
        """End what is under way; may be called again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class Workers(Closing):
    """Worker processes, each of which makes its share of the numbers from one on.

    They end with this process, however that ends: they find no reader for what they make next. Close them, or use them
    in a `with` statement, to end them at once.

    Args:
        maker: makes what is asked for.
        count: number of processes.
        ahead: number of finished things each worker keeps ready, besides the one that it is making; 0: as many as there
            are up to one that `ends` is true for.
        ends: tells the last thing of a group.
    """

    def __init__(self, maker: Maker, count: int, ahead: int, ends: Callable[[Any], bool] = lambda made: False) -> None:
        self._maker, self._count, self._ahead, self._ends, self._first = maker, count, ahead, ends, 0
        self._workers: list[_Worker] = []
        weakref.finalize(self, _end_all, self._workers)  # also when the interpreter exits

    def start(self, first: int) -> None:
        """Begin with this number; what was made before is lost.

        Raises:
            InvalidValueError: the maker cannot be pickled.
        """
        self.close()
        self._first = first
        try:
            for k in range(self._count):
                self._workers.append(_Worker(self._maker, first + k, self._count, self._ahead, self._ends))
        except BaseException:
            self.close()
            raise

    def next_of(self, number: int) -> Any:
        """Return the next thing from the worker whose share this number is, or its `Failure`, after which all end."""
        made = self._workers[(number - self._first) % self._count].ready.get()
        if isinstance(made, Failure):
            self.close()
        return made

    def close(self) -> None:
        """End the workers; may be called again."""
        _end_all(self._workers)


class ClipsAhead(Closing):
    """Clips of a source, made ahead by worker processes for sequential access; close it as `Workers`.

    Args:
        source: picklable source, whose class may be of the caller's script.
        workers: number of processes.
        ahead: finished clips that each worker keeps ready, besides the one that it is making.
    """

    def __init__(self, source: ClipSource, workers: int = 1, ahead: int = 2) -> None:
        require_count(1, workers=workers, ahead=ahead)
        self._workers, self._next = Workers(ClipMaker(source), workers, ahead), -1

    def clip(self, index: int) -> Clip:
        """Return a clip, without delay if it follows the one before and is made.

        Raises:
            CoopsimError: the source raised it, or another error, whose traceback it then has; or a worker was killed.
            InvalidValueError: the source cannot be pickled.
        """
        if index != self._next:
            self._workers.start(index)
        self._next = -1
        made = self._workers.next_of(index)
        if isinstance(made, Failure):
            raise made.error(f"clip {index}")
        self._next = index + 1
        clip: Clip = made
        return clip

    def close(self) -> None:
        """End the workers; may be called again."""
        self._workers.close()
        self._next = -1


class _Worker:
    """A process that makes every `stride`-th thing, and a thread that fetches them into a queue."""

    def __init__(self, maker: Maker, first: int, stride: int, ahead: int, ends: Callable[[Any], bool]) -> None:
        try:
            order = pickle.dumps(pack_registrations()) + cloudpickle.dumps((maker, first, stride))
        except Exception as error:
            raise InvalidValueError(f"source must be picklable to be given to workers: {error}") from error
        self._owner = os.getpid()
        self.ready: queue.Queue[Any] = queue.Queue(ahead)
        self._ends, self._ended = ends, threading.Event()
        self._process = start_python(_PROGRAM)
        assert self._process.stdin is not None and self._process.stdout is not None
        widen(self._process.stdout)
        with contextlib.suppress(BrokenPipeError):  # the thread finds out why
            self._process.stdin.write(order)
            self._process.stdin.close()
        self._thread = threading.Thread(target=self._fetch, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Kill the process, unless this is a fork of the one whose worker it is."""
        if os.getpid() != self._owner:
            return
        self._ended.set()
        self._process.kill()
        self._process.wait()
        self._thread.join()  # a thread that makes arrays while the interpreter ends would crash it

    def _fetch(self) -> None:
        """Put into the queue what the process sends, until it sends no more."""
        assert self._process.stdout is not None
        with self._process.stdout as outlet:
            while not self._ended.is_set():
                try:
                    made = receive(outlet)
                except EOFError:
                    made = Failure(f"its worker ended: {cause_of_end(self._process.wait())}")
                self._put(made)
                if isinstance(made, Failure):
                    return

    def _put(self, made: Any) -> None:
        """Put a thing into the queue when there is room, and wait until a group that it ends is taken."""
        while not self._ended.is_set():
            with contextlib.suppress(queue.Full):
                self.ready.put(made, timeout=_PATIENCE_S)
                break
        while self._ends(made) and not self.ready.empty() and not self._ended.is_set():
            time.sleep(_PATIENCE_S / 10)


def _end_all(workers: list[_Worker]) -> None:
    while workers:
        workers.pop().end()


def serve() -> None:
    """Make things until the reader is gone or an error is raised: the program of a worker."""
    outlet = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a source prints must not get among what is made
    limit_threads(1)
    try:
        for made in _made(sys.stdin.buffer):
            send(outlet, made)
    except (BrokenPipeError, EOFError):
        os._exit(0)


def _made(inlet: BinaryIO) -> Iterator[Any]:
    """Yield what is made without an end, or an error last."""
    try:
        register_packed(pickle.load(inlet))
        maker, first, stride = pickle.load(inlet)
    except EOFError:
        raise
    except Exception:  # one that can be pickled, but not made again
        yield Failure(traceback.format_exc())
        return
    yield from until_failure(maker, first, stride)


def until_failure(maker: Maker, first: int, stride: int) -> Iterator[Any]:
    """Yield what a maker makes, and its error as the last."""
    try:
        yield from maker.make(first, stride)
    except CoopsimError as error:
        yield Failure(error)
    except Exception:  # of a user's source
        yield Failure(traceback.format_exc())
