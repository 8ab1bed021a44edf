"""Objects of annotated dataclasses from entries, and back: the annotations say what is accepted.

| annotation | accepted |
|---|---|
| a dataclass | keys, which are names of its fields, or `metadata["key"]` of a field |
| `Point`, `Line` | `[x, y]`, a list of these, m |
| `tuple[X, ...]`, `Mapping[str, X]` | a list, names with values |
| `str`, `float`, `bool` | a name, a finite number, true or false |
| `Annotated[X, Checked(...)]`, `OneOf(...)`, `AtLeast(...)` | fewer of these |
| `X | None` | X |

Numbers stay as they are written: an object reads back from its own plain data as an equal one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

from coopsim.config.checked_entry import Entry
from coopsim.support.checks import require_finite_number, require_flag

Point = tuple[float, float]
"""Place x, y, m."""

Line = tuple[Point, ...]
"""Places along a line, or the corners of an outline, m."""


class Checked(NamedTuple):
    """A value that a function of `coopsim.support.checks` accepts after `limits`."""

    check: Callable[..., None]
    limits: tuple[Any, ...] = ()


class OneOf(NamedTuple):
    """An accepted name; `kind` is the kind of thing that it names, if that is not the key."""

    accepted: tuple[str, ...]
    kind: str | None = None


class AtLeast(NamedTuple):
    """A line of at least so many points."""

    points: int


class Key(NamedTuple):
    """A key of a mapping: the field that it is for, its annotation, and whether it is needed."""

    field: str
    annotation: Any
    needed: bool


@cache
def keys_of(kind: type[Any]) -> Mapping[str, Key]:
    """Return the keys that stand for the fields of a dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        each.metadata.get("key", each.name): Key(
            each.name, hints[each.name], each.default is MISSING and each.default_factory is MISSING
        )
        for each in fields(kind)
    }


def read(annotation: Any, entry: Entry) -> Any:
    """Return the value of an entry as an annotation says; the entry's error says what is accepted instead."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if is_dataclass(annotation):
        return _read_object(annotation, entry)
    if origin is Annotated:
        return _read_checked(parts[1], entry)
    if origin in (Union, UnionType):
        return read(parts[0], entry)
    if annotation == Point:
        return entry.pair()
    if annotation == Line:
        return entry.polyline()
    if origin is tuple:
        return tuple(read(parts[0], item) for item in entry.entries())
    if origin is Mapping:
        return {name: read(parts[1], item) for name, item in entry.named().items()}
    return entry.text() if annotation is str else entry.checked(_CHECKS[annotation])


_CHECKS: Mapping[Any, Callable[..., None]] = {float: require_finite_number, bool: require_flag}


def _read_object(kind: Any, entry: Entry) -> Any:
    keys = keys_of(kind)
    found = entry.fields([name for name in keys if keys[name].needed], [name for name in keys if not keys[name].needed])
    return kind(**{keys[name].field: read(keys[name].annotation, item) for name, item in found.items()})


def _read_checked(rule: Checked | OneOf | AtLeast, entry: Entry) -> Any:
    if isinstance(rule, OneOf):
        return entry.choice(rule.accepted, rule.kind)
    if isinstance(rule, AtLeast):
        return entry.polyline(rule.points)
    return entry.checked(rule.check, *rule.limits)


def plain_of(value: Any) -> Any:
    """Return plain data from which an equal value is read; fields with their default values are left out."""
    if type(value) in _PLAIN:  # places have a hundred thousand of them
        return value
    if isinstance(value, (tuple, list)):
        return [each if type(each) in _PLAIN else plain_of(each) for each in value]
    if isinstance(value, Mapping):
        return {name: plain_of(item) for name, item in value.items()}
    if not is_dataclass(value) or isinstance(value, type):
        return value
    found = ((name, getattr(value, field), default) for name, field, default in _defaults_of(type(value)))
    return {name: plain_of(own) for name, own, default in found if own != default}


_PLAIN = frozenset({float, int, bool, str, type(None)})


@cache
def _defaults_of(kind: Any) -> tuple[tuple[str, str, Any], ...]:
    """Return the key, the field and the default value of each field of a dataclass."""
    defaults = {each.name: each.default for each in fields(kind)}
    return tuple((name, key.field, defaults[key.field]) for name, key in keys_of(kind).items())
