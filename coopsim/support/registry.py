"""One registry for everything that is looked up by name: policies, environments, scenarios, sensors."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from coopsim.errors import DuplicateNameError, UnknownNameError

T = TypeVar("T")


class Registry(Generic[T]):
    """Names to objects. A duplicate raises; an unknown name raises and lists the close ones.

    Args:
        kind: what is registered, in the singular, for error messages ("policy").
        home: a module imported at the first look-up, whose import registers the built-in entries. It is
            named, not imported, so that the library does not depend on what is plugged into it.
        group: an entry-point group through which installed packages add entries; their names are known
            at once, their modules are loaded when asked for.
    """

    def __init__(self, kind: str, *, home: str | None = None, group: str | None = None) -> None:
        self.kind = kind
        self._home, self._group = home, group
        self._entries: dict[str, T] = {}
        self._aliases: dict[str, str] = {}

    def register(self, name: str, *, alias: str | None = None) -> Callable[[T], T]:
        """Return a decorator that enters the decorated object under `name`.

        Args:
            name: of the entry.
            alias: a second name that is found too, but not listed, so that lists count the entry once.
        """

        def enter(entry: T) -> T:
            for each in (name, *([] if alias is None else [alias])):
                if each in self._entries or each in self._aliases:
                    raise DuplicateNameError(f"{self.kind} {each!r} is already registered")
            self._entries[name] = entry
            if alias is not None:
                self._aliases[alias] = name
            return entry

        return enter

    def get(self, name: str) -> T:
        """The entry called `name`; raises `UnknownNameError` when there is none."""
        self._load_home()
        # Whoever gives no string is told so, too: the annotation does not keep anybody from it.
        if isinstance(name, str):
            name = self._aliases.get(name, name)
            if name in self._entries:
                return self._entries[name]
            for point in self._points():
                if point.name == name:
                    self._entries[name] = point.load()
                    return self._entries[name]
        raise UnknownNameError(self.kind, name, self.names())

    def names(self) -> tuple[str, ...]:
        """All known names, sorted."""
        self._load_home()
        return tuple(sorted({*self._entries, *(point.name for point in self._points())}))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._aliases.get(name, name) in self.names()

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def _load_home(self) -> None:
        if self._home is not None:
            importlib.import_module(self._home)

    def _points(self) -> Iterable[EntryPoint]:
        return _points_of(self._group) if self._group else ()


@cache
def _points_of(group: str) -> Iterable[EntryPoint]:
    # Read once: it takes milliseconds, and names are asked for often.
    return tuple(entry_points(group=group))
