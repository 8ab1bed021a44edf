"""Watching of weights that a policy or a detector loads. This does not load torch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

_FOUND: ContextVar[dict[Path, str] | None] = ContextVar("found", default=None)


@contextmanager
def watch_weights() -> Iterator[dict[Path, str]]:
    """Collect the weights that are looked up within the block, by this thread: their files, and their names."""
    found = dict[Path, str]()
    before = _FOUND.set(found)
    try:
        yield found
    finally:
        _FOUND.reset(before)


def note_weights(name_or_path: str | Path, path: Path) -> Path:
    """Tell the watching block, if there is one, that weights are looked up. Return the path of their file.

    The library looks up by path what was found by name, so the first name of a file counts.
    """
    found = _FOUND.get()
    if found is not None:
        found.setdefault(path, str(name_or_path))
    return path
