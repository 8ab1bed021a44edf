"""Which weights a policy or a detector loads. This does not load torch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_FOUND: ContextVar[set[str] | None] = ContextVar("found", default=None)


@contextmanager
def watch_weights() -> Iterator[set[str]]:
    """Collect the names and paths of the weights that are looked up within the block, by this thread."""
    found = set[str]()
    before = _FOUND.set(found)
    try:
        yield found
    finally:
        _FOUND.reset(before)


def note_weights(name_or_path: object) -> None:
    """Tell the watching block, if there is one, that weights are looked up."""
    found = _FOUND.get()
    if found is not None:
        found.add(str(name_or_path))
