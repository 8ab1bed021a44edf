"""Values of a description, from a file or in memory, that know where they are, so that errors can say what is wrong."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from types import NoneType
from typing import Any

import numpy as np

from coopsim.errors import CoopsimError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_finite_number

ROOT = "file"
"""Name of the outermost entry of a file."""


class Entry(ABC):
    """A value. Methods that ask for a kind of value raise an error with place and name for any other.

    Args:
        name: its key, or the key of the list that it is in.
        kind: class of the errors about it.
    """

    __slots__ = ("kind", "name")

    def __init__(self, name: str, kind: type[CoopsimError]) -> None:
        self.name, self.kind = name, kind

    @property
    @abstractmethod
    def value(self) -> Any:
        """The value as plain Python."""

    @property
    @abstractmethod
    def spot(self) -> str:
        """The place, for errors about other entries: "line 8"."""

    @abstractmethod
    def error(self, message: str) -> CoopsimError:
        """Return an error that says where."""

    @abstractmethod
    def items(self) -> Sequence[Entry] | None:
        """Return the items of a list; None: it is no list."""

    @abstractmethod
    def pairs(self) -> Mapping[str, Entry] | None:
        """Return the values of a mapping by key; None: it is no mapping."""

    @abstractmethod
    def part(self, *keys: str | int) -> Entry:
        """Return what keys and numbers in lists lead to; in a file, the last on the way there that is written."""

    @abstractmethod
    def scalar(self) -> str | None:
        """Return a number or text as it is written; None: it is neither."""

    def fields(
        self, required: Collection[str], optional: Collection[str] = (), elsewhere: Mapping[str, str] | None = None
    ) -> Mapping[str, Entry]:
        """Return the values by key; raise an error if a required key is missing, or a key is unknown.

        `elsewhere` are keys that belong elsewhere in the file, and where: "below options".
        """
        found = self.pairs()
        if found is None or not all(name in required or name in optional for name in found):
            known = sorted([*required, *optional])
            found = self.named(f"Accepted: {', '.join(known)}")
            raise self._unknown(next(name for name in found if name not in known), found, known, elsewhere or {})
        for name in required:
            if name not in found:
                accepted = ", ".join(sorted([*required, *optional]))
                raise self.error(f"{name} is missing in {self.name}. Accepted: {accepted}")
        return found

    def _unknown(
        self, name: str, found: Mapping[str, Entry], known: Collection[str], elsewhere: Mapping[str, str]
    ) -> CoopsimError:
        if name in elsewhere:
            return found[name].error(f"{name} belongs {elsewhere[name]}")
        where = "" if self.name == ROOT else f" in {self.name}"
        return found[name].error(str(UnknownNameError(f"key{where}", name, known)))

    def named(self, hint: str = "Accepted: names of your own") -> Mapping[str, Entry]:
        """Return the values of a mapping with any keys, by key."""
        found = self.pairs()
        if found is None:
            raise self.error(f"{self.name}: expected keys and values. {hint}")
        return found

    def entries(self, of: str = "") -> Sequence[Entry]:
        """Return the items of a list; `of` says in words what they are, as " of names"."""
        found = self.items()
        if found is None:
            raise self.error(f"{self.name} must be a list{of}, got {self._shown()}")
        return found

    def checked(self, check: Callable[..., None], *limits: Any) -> Any:
        """Return the value if a function of `coopsim.support.checks` accepts it after `limits`."""
        value = self.value
        try:
            check(*limits, **{self.name: value})
        except CoopsimError as error:
            raise self.error(str(error)) from error
        return value

    def text(self) -> str:
        """Return a name as it is written; a number is a name, too."""
        found = self.scalar()
        if found is None:
            raise self.error(f"{self.name} must be a name, got {self._shown()}")
        return found

    def choice(self, accepted: Collection[str], kind: str | None = None) -> str:
        """Return one of the accepted names."""
        name = self.text()
        if name not in accepted:
            try:
                require_choice(kind or self.name, name, accepted)
            except CoopsimError as error:
                raise self.error(str(error)) from error
        return name

    def numbers(self, count: int | None = None) -> list[float]:
        """Return a list of finite numbers, of length `count` if it is given."""
        items = self.entries()
        if count is not None and len(items) != count:
            raise self.error(f"{self.name} must be {count} numbers, got {self._shown()}")
        return [item.checked(require_finite_number) for item in items]

    def pair(self) -> tuple[float, float]:
        """Return a point as two numbers, m."""
        if self.items() is None:
            raise self.error(f"{self.name} must have points [x, y], got {self._shown()}")
        x, y = self.numbers(2)
        return x, y

    def polyline(self, least: int = 0) -> tuple[tuple[float, float], ...]:
        """Return at least so many points, m."""
        items = self.entries()
        if len(items) < least:
            raise self.error(f"{self.name} must be at least {least} points [x, y], got {len(items)}")
        return tuple(item.pair() for item in items)

    def point(self) -> Floats:
        """Return a point (2,) m."""
        return np.array(self.pair(), dtype=np.float64)

    def points(self, least: int) -> Floats:
        """Return points (N, 2) m, N >= `least`."""
        return np.array(self.polyline(least), dtype=np.float64)

    def _shown(self) -> str:
        text = repr(self.value)
        return text if len(text) <= 60 else f"{text[:57]}..."


def plain(value: Any) -> Any:
    """Return a copy of plain data: mappings as dicts with texts as keys, lists and tuples as lists.

    Numpy's numbers are made Python's. All else is kept: whoever reads it says what is accepted.
    """
    if isinstance(value, float):  # as numpy's own are
        return float(value)
    if type(value) in (int, str, bool, NoneType):
        return value
    if isinstance(value, (list, tuple)):
        return [float(item) if isinstance(item, float) else plain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value


class DataEntry(Entry):
    """A value in memory; errors name the keys that lead to it: `key`, or place, in the list or mapping `above`."""

    __slots__ = ("_above", "_key", "_value")

    def __init__(
        self, value: Any, name: str, kind: type[CoopsimError], above: DataEntry | None = None, key: str | int = ""
    ) -> None:
        super().__init__(name, kind)
        self._value, self._above, self._key = value, above, key

    @property
    def value(self) -> Any:
        return self._value

    @property
    def spot(self) -> str:
        if self._above is None:
            return ""
        own = f"[{self._key}]" if isinstance(self._key, int) else f".{self._key}"
        return f"{self._above.spot}{own}".removeprefix(".")

    def error(self, message: str) -> CoopsimError:
        return self.kind(f"{self.spot}: {message}" if self.spot else message)

    def items(self) -> list[Entry] | None:
        if not isinstance(self._value, list):
            return None
        return [DataEntry(item, self.name, self.kind, self, k) for k, item in enumerate(self._value)]

    def pairs(self) -> dict[str, Entry] | None:
        if not isinstance(self._value, dict):
            return None
        return {key: DataEntry(item, key, self.kind, self, key) for key, item in self._value.items()}

    def part(self, *keys: str | int) -> DataEntry:
        found = self
        for key in keys:
            has = isinstance(found._value, dict) if isinstance(key, str) else isinstance(found._value, list)
            value = found._value[key] if has and (isinstance(key, int) or key in found._value) else None
            found = DataEntry(value, found.name if isinstance(key, int) else key, self.kind, found, key)
        return found

    def scalar(self) -> str | None:
        return str(self._value) if isinstance(self._value, (str, int)) and not isinstance(self._value, bool) else None
