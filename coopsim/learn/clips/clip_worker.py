"""The program of a process that makes clips for another.

It reads the source and its share of the indices from its standard input, and writes clips to what was its standard
output, each as its length in eight bytes and its pickle, until nobody reads them any more. A pipe holds little, so it
is never further ahead than its reader lets it.
"""

from __future__ import annotations

import os
import pickle
import struct
import sys
import traceback
from typing import BinaryIO

from coopsim.errors import CoopsimError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_store import ClipSource
from coopsim.support.threads import limit_threads

LENGTH = struct.Struct("<Q")

Made = Clip | CoopsimError | str
"""A clip; or why there is none and no later one: coopsim's own error, or the traceback of another."""


def serve() -> None:
    """Make clips until the reader is gone or an error is raised."""
    outlet = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a source prints must not get among the clips
    limit_threads(1)
    try:
        _serve(sys.stdin.buffer, outlet)
    except (BrokenPipeError, EOFError):
        os._exit(0)


def _serve(inlet: BinaryIO, outlet: BinaryIO) -> None:
    try:
        source, index, stride = pickle.load(inlet)
    except EOFError:
        raise
    except Exception:  # a source that can be pickled, but not made again
        return _send(outlet, traceback.format_exc())
    while True:
        made = make(source, index)
        _send(outlet, made)
        if not isinstance(made, Clip):
            return None
        index += stride


def make(source: ClipSource, index: int) -> Made:
    """Return a clip of a source, or its error."""
    try:
        return source.clip(index)
    except CoopsimError as error:
        return error
    except Exception:  # of a user's source
        return traceback.format_exc()


def _send(outlet: BinaryIO, made: Made) -> None:
    content = pickle.dumps(made, protocol=5)
    for part in (LENGTH.pack(len(content)), content):
        left = memoryview(part)
        while left:  # an unbuffered file writes what fits
            left = left[outlet.write(left) :]
