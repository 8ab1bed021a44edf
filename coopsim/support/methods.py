"""Methods: which of two a subclass overrides, and references to an object's own methods."""

from __future__ import annotations

import weakref
from collections.abc import Callable
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
