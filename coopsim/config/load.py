"""Objects from plain data, as the annotations of their classes say.

| annotation | accepted data |
|---|---|
| a dataclass | a mapping of its fields |
| a base class in `models` | a mapping with `model`, the name of one of its models, and that model's parameters |
| `Mapping[str, X]` | names, each with data for X |
| `X | Mapping[str, X]` | data for X, which is for all agents; or agents, as `cav_0`, each with data for X |

All other values, None, and ready objects are taken as they are: their class checks them. Errors about data from a file
begin with file and line.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import is_dataclass
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from coopsim.config.yaml_file import Section, read_yaml
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.support.checks import require_choice

Models = Mapping[type[Any], Mapping[str, Callable[..., Any]]]
"""Classes or factories that `model` chooses from, by base class and name."""

_MODEL = "model"
_AGENT = re.compile(r".+_\d+")
_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")


def load(annotation: Any, given: Any, what: str, models: Models | None = None) -> Any:
    """Make an object from plain data.

    Args:
        annotation: a class, or another annotation of the table above.
        given: the data.
        what: name of the data, for errors.
        models: models of base classes.

    Raises:
        CoopsimError: something is no mapping, a field is missing or unknown, or a value is not accepted; says where.
    """
    models = models or {}
    kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    classes = [kind for kind in kinds if is_dataclass(kind) or kind in models]
    named = [kind for kind in kinds if _is_named(kind, models)]
    if given is None or not (classes or named) or isinstance(given, tuple(classes)):
        return given
    if not isinstance(given, Mapping):
        if any(kind not in (*classes, *named, NoneType) for kind in kinds):
            return given
        raise InvalidValueError(f"{what} must be a mapping, got {given!r}")
    if named and (not classes or _is_by_agent(classes[0], given)):
        item, prefix = get_args(named[0])[1], what.removesuffix("s") + (" of" if classes else "")
        return {name: _part(item, given, name, f"{prefix} {name}", models) for name in given}
    if classes[0] in models:
        return _make(_model(given, what, models[classes[0]]), given, what, models, skipped=_MODEL)
    return _make(classes[0], given, what, models)


def read_mapping(what: str, accepted: str, given: Any) -> Mapping[str, Any]:
    """Return a mapping, or read it from the path of a YAML file, whose own paths are relative to the file.

    `what` is its name and `accepted` are further alternatives of the user, for errors.

    Raises:
        InvalidValueError: it is neither, or the file cannot be read or is no YAML.
    """
    source = ""
    if isinstance(given, (str, Path)):
        source = f"{given}: "
        try:
            given = read_yaml(Path(given), InvalidValueError).value
        except InvalidValueError as error:
            raise InvalidValueError(f"{what}: {error}") from error
    if not isinstance(given, Mapping):
        accepted = f"{accepted}, a mapping or the path of a YAML file"
        raise InvalidValueError(f"{source}{what} must be {accepted}, got {given!r}")
    return given.with_paths() if isinstance(given, Section) else given


def has_parameters(make: Callable[..., Any], names: Iterable[object]) -> bool:
    """Return whether any name is that of a parameter of a class or factory, or nearly so: a misspelt one."""
    known = list(inspect.signature(make).parameters)
    return any(get_close_matches(str(name), known, n=1, cutoff=0.75) for name in names)


def _is_named(annotation: Any, models: Models) -> bool:
    """Return whether an annotation is `Mapping[str, X]`, with X a class to make."""
    item = get_args(annotation)[1] if get_origin(annotation) is Mapping else None
    return is_dataclass(item) or item in models


def _is_by_agent(made: type[Any], given: Mapping[str, Any]) -> bool:
    return any(_AGENT.fullmatch(str(name)) for name in given) or not has_parameters(made, given)


def _model(given: Mapping[str, Any], what: str, known: Mapping[str, Callable[..., Any]]) -> Callable[..., Any]:
    name = given.get(_MODEL)
    if name is None:
        raise InvalidValueError(f"{what}: model must be given, got {sorted(given)}; accepted: {', '.join(known)}")
    try:
        require_choice(f"{what} model", name, known)
    except UnknownNameError as error:
        raise error.at(_place(given, _MODEL)) from None
    return known[name]


def _make(make: Callable[..., Any], given: Mapping[str, Any], what: str, models: Models, skipped: str = "") -> Any:
    """Call a class or factory with all given keys except `skipped`."""
    parameters, annotations = inspect.signature(make).parameters, get_type_hints(make)
    names = [name for name in given if name != skipped]
    for name in names:
        if name not in parameters:
            raise UnknownNameError(f"{what} option", name, parameters).at(_place(given, name))
    missing = [name for name, each in parameters.items() if each.default is each.empty and name not in names]
    if missing:
        raise InvalidValueError(f"{what}: {' and '.join(missing)} must be given, got {sorted(given)}")
    values = {name: _part(annotations[name], given, name, f"{what} {name}", models) for name in names}
    try:
        return make(**values)
    except UnknownNameError as error:
        unknown = UnknownNameError(f"{what} {error.kind}", error.name, error.known, error.where)
        raise unknown.at(_place_of(given, error)) from error
    except InvalidValueError as error:
        raise InvalidValueError(f"{what}: {error}{_hint(given)}").at(_place_of(given, error)) from error


def _part(annotation: Any, given: Mapping[str, Any], name: str, what: str, models: Models) -> Any:
    try:
        return load(annotation, given[name], what, models)
    except CoopsimError as error:
        raise error.at(_place(given, name)) from error.__cause__


def _place(given: Mapping[str, Any], name: str) -> str | None:
    return given.place(name) if isinstance(given, Section) else None


def _place_of(given: Mapping[str, Any], error: CoopsimError) -> str | None:
    """Return the place of the field that an error names, or of all fields."""
    return (given.blame(error) or given.place()) if isinstance(given, Section) else None


def _hint(given: Mapping[str, Any]) -> str:
    """Explain numbers that YAML 1.1 reads as texts: it needs a point before an exponent, and a sign behind the e."""
    texts = [repr(value) for value in given.values() if isinstance(value, str) and _EXPONENT.fullmatch(value)]
    return f" ({', '.join(texts)} is a text in YAML: write it like 6.0e+6)" if texts else ""
