"""Methods: which of two a subclass overrides, references to an object's own methods, and garbage collection."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Generic, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class WeakMethod(Generic[P, T]):
    """Method that does not keep its object alive, for parts of that object; a copy of the object calls the copy.

    An object that holds its own methods ends only when Python looks for cycles, and with it all that it holds.
    """

    def __init__(self, method: Callable[P, T]) -> None:
        self._owner, self._name = weakref.ref(method.__self__), method.__name__  # type: ignore[attr-defined]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> T:
        result: T = getattr(self._owner(), self._name)(*args, **kwargs)
        return result

    def __reduce__(self) -> tuple[Any, ...]:
        return WeakMethod, (getattr(self._owner(), self._name),)


def is_newer(cls: type, one: str, batch: str) -> bool:
    """Return whether a class has a newer method `one` than `batch`, its counterpart for all at once."""
    place = {name: next(k for k, each in enumerate(cls.__mro__) if name in vars(each)) for name in (one, batch)}
    return place[one] < place[batch]


@contextmanager
def garbage_collection_paused() -> Iterator[None]:
    """Let Python not look for unused cycles of objects in a block that makes many objects and no cycles.

    Python looks for them each time that some hundred objects have been made, now and then among all that there are.
    Where tens of thousands are made that stay, as in a description of a place, that takes a fifth of the time.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
