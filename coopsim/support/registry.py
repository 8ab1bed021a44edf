"""The registry for everything that is looked up by name: policies, environments, codecs, ..."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar
from weakref import WeakSet

from coopsim.errors import CoopsimError, DuplicateNameError, PlugInError, UnknownNameError
from coopsim.support.printable import require_printable

T = TypeVar("T")


_REGISTRIES: WeakSet[Registry[Any]] = WeakSet()
_LIBRARY = "coopsim"


class Registry(Generic[T]):
    """Objects by name. Registering a name twice raises; an unknown name raises and lists the close ones.

    `kind` is the objects', in the singular, for error messages ("policy"). `home` names the modules that are
    imported at the first look-up, and register the built-in entries: the library does not import its plug-ins. `group`
    is an entry-point group through which installed packages add entries. Their names are known at once; their modules
    are loaded when an entry is looked up.
    """

    def __init__(self, kind: str, *, home: str | Sequence[str] = (), group: str | None = None) -> None:
        self.kind = kind
        self._modules, self._group = (home,) if isinstance(home, str) else tuple(home), group
        self._entries: dict[str, T] = {}
        self._aliases: dict[str, str] = {}
        self._homes: dict[str, str] = {}
        self._module = sys._getframe(1).f_globals.get("__name__", "")
        _REGISTRIES.add(self)

    def register(self, name: str, *, alias: str | None = None) -> Callable[[T], T]:
        """Return a decorator that registers an object; an alias is found, too, but not listed."""
        home = _registrant()

        def enter(entry: T) -> T:
            for each in (name, *([] if alias is None else [alias])):
                require_printable(**{f"name of a {self.kind}": each})
                if each in self._entries or each in self._aliases:
                    raise DuplicateNameError(f"{self.kind} {each!r} is already registered")
            self._entries[name], self._homes[name] = entry, home
            if alias is not None:
                self._aliases[alias] = name
            return entry

        return enter

    def get(self, name: str) -> T:
        """Return the entry called `name`.

        Raises:
            UnknownNameError: there is none.
            PlugInError: it is of an installed package, and cannot be loaded.
        """
        self._load_home()
        if isinstance(name, str):  # callers may ignore the annotation
            name = self._aliases.get(name, name)
            if name in self._entries:
                return self._entries[name]
            for point in self._points:
                if point.name == name:
                    self._entries[name] = self._loaded(point)
                    return self._entries[name]
        raise UnknownNameError(self.kind, name, (*self.names(), *self._aliases))

    def _loaded(self, point: EntryPoint) -> T:
        try:
            return point.load()  # type: ignore[no-any-return]
        except CoopsimError:  # as where it says what to install
            raise
        except Exception as error:  # a module may raise anything when it is imported
            why = f"{type(error).__name__}: {error}".splitlines()[0]
            raise PlugInError(f"{self.source_of(point.name)} raised {why}") from error

    def source_of(self, name: str) -> str:
        """Describe where an entry comes from: the package and module of an entry point, else this program."""
        for point in self._points:
            if point.name == name:
                package = "" if point.dist is None else f"package {point.dist.name!r}, "
                return f"{package}entry point {point.value!r}"
        return "this program"

    def is_installed(self, name: str) -> bool:
        """Return whether an entry is of an installed package, by an entry point."""
        return any(point.name == name for point in self._points)

    def name_of(self, entry: type) -> str:
        """Return the name under which a class is registered; raise `UnknownNameError` if it is not."""
        self._load_home()
        names = [name for name, known in self._entries.items() if known is entry]
        names += [point.name for point in self._points if point.value == f"{entry.__module__}:{entry.__qualname__}"]
        if not names:
            raise UnknownNameError(f"{self.kind} class", entry.__qualname__, self.names())
        return names[0]

    def added(self) -> dict[str, str]:
        """Return the modules that have registered entries, by name, of those that are outside the library."""
        homes = {name: home for name, home in self._homes.items() if name in self._entries}
        return {name: home for name, home in homes.items() if home.partition(".")[0] != _LIBRARY}

    def aliases_of(self, name: str) -> tuple[str, ...]:
        """Return the second names of the entry called `name`."""
        return tuple(alias for alias, entry in self._aliases.items() if entry == name)

    def names(self) -> tuple[str, ...]:
        """Return all known names, sorted."""
        self._load_home()
        return tuple(sorted({*self._entries, *(point.name for point in self._points)}))

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        known = self._aliases.get(name, name)
        return known in self._entries or known in self.names()

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickle a module's registry as its place: another process has its own."""
        names = [name for name, value in vars(sys.modules.get(self._module)).items() if value is self]
        return (_registry_at, (self._module, names[0])) if names else super().__reduce_ex__(protocol)

    def _load_home(self) -> None:
        for module in self._modules:
            importlib.import_module(module)

    @cached_property
    def _points(self) -> tuple[EntryPoint, ...]:
        return tuple(entry_points(group=self._group)) if self._group else ()


def registries() -> list[Registry[Any]]:
    """Return the registries that this process has loaded, sorted by kind."""
    return sorted(_REGISTRIES, key=lambda each: each.kind)


def _registry_at(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


def _registrant() -> str:
    """Return the name of the module that registers: the first one outside the library that called, or the library's."""
    frame = sys._getframe(2)
    while frame.f_back is not None and frame.f_code.co_name != "<module>" and _is_ours(frame.f_globals):
        frame = frame.f_back
    return str(frame.f_globals.get("__name__", ""))


def _is_ours(content: dict[str, Any]) -> bool:
    return str(content.get("__name__", "")).partition(".")[0] == _LIBRARY
