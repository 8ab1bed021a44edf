"""Plain data as objects: mappings, and YAML files with one, for experiments that are written down."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from coopsim.errors import InvalidValueError, UnknownNameError

Given = Mapping[str, Any]

UNREADABLE = (OSError, ValueError, RecursionError, yaml.YAMLError)
"""What reading YAML may raise: not only its own errors, but those of a day that no month has, or of 1000 brackets."""

PATH_KEYS = ("channel", "lidar", "localization", "path", "pattern", "playback")
"""Keys whose texts may be the path of a file."""

_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")


def read_mapping(what: str, kind: str, given: Any) -> Given:
    """A mapping from itself, or from the path of a YAML file with one, whose own paths are relative to it.

    Args:
        what: its name, for errors.
        kind: what else it might have been, for errors.
        given: what the user gave.

    Raises:
        InvalidValueError: it is neither, or the file is not there or no YAML.
    """
    source = ""
    if isinstance(given, (str, Path)):
        path = Path(given)
        source, given = f"{given}: ", _read(what, path)
        given = with_paths_from(path.parent, given) if isinstance(given, Mapping) else given
    if not isinstance(given, Mapping):
        raise InvalidValueError(f"{source}{what} must be {kind}, a mapping or the path of a YAML file, got {given!r}")
    return given


def with_paths_from(folder: Path, given: Given) -> dict[str, Any]:
    """The same, with paths taken as relative to the folder where there is such a file in it.

    Paths are the texts under the keys of `PATH_KEYS`, at any depth; what lies elsewhere, or is a name, stays as it is.
    """

    def taken(key: str, value: Any) -> Any:
        if isinstance(value, Mapping):
            return with_paths_from(folder, value)
        return beside(folder, value) if key in PATH_KEYS and isinstance(value, str) else value

    return {key: taken(key, value) for key, value in given.items()}


def beside(folder: str | Path, path: str) -> str:
    """The path of the file in that folder if there is one, else the path as it is."""
    return str(found) if (found := Path(folder, path)).is_file() else path


def make(what: str, made: type[Any], given: Any) -> Any:
    """An object of a dataclass from a mapping of its fields; what is one, or None, is left as it is.

    Raises:
        InvalidValueError: it is no mapping, a field is missing, or a value is not accepted; the message begins with
            `what`.
        UnknownNameError: a field that there is not.
    """
    if given is None or isinstance(given, made):
        return given
    fields = [field for field in dataclasses.fields(made) if field.init]
    for name in require_mapping(what, given):
        if name not in [field.name for field in fields]:
            raise UnknownNameError(f"{what} option", name, [field.name for field in fields])
    missing = [field.name for field in fields if _is_needed(field) and field.name not in given]
    if missing:
        raise InvalidValueError(f"{what}: {' and '.join(missing)} must be given, got {sorted(given)}")
    try:
        return made(**given)
    except UnknownNameError as error:
        raise UnknownNameError(f"{what} {error.kind}", error.name, error.known) from error
    except InvalidValueError as error:
        raise InvalidValueError(f"{what}: {error}{_hint(given)}") from error


def require_mapping(what: str, given: Any) -> Given:
    """It must be a mapping."""
    if not isinstance(given, Mapping):
        raise InvalidValueError(f"{what} must be a mapping, got {given!r}")
    return given


def _is_needed(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _hint(given: Given) -> str:
    """YAML 1.1 takes an exponent for one only behind a point and before a sign."""
    texts = [repr(value) for value in given.values() if isinstance(value, str) and _EXPONENT.fullmatch(value)]
    return f" ({', '.join(texts)} is a text in YAML: write it like 6.0e+6)" if texts else ""


def alias_in_itself(node: yaml.Node | None) -> yaml.Node | None:
    """The first node of a YAML document that contains itself, by an alias; None in nearly all."""
    finished: set[int] = set()

    def search(node: yaml.Node, above: frozenset[int]) -> yaml.Node | None:
        if id(node) in above:
            return node
        if id(node) in finished or isinstance(node, yaml.ScalarNode):
            return None
        parts = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        found = (search(part, above | {id(node)}) for part in parts)
        first = next((part for part in found if part is not None), None)
        finished.add(id(node))
        return first

    return None if node is None else search(node, frozenset())


def _read(what: str, path: Path) -> Any:
    try:
        text = path.read_text(encoding="utf-8")
        if alias_in_itself(yaml.compose(text, Loader=yaml.SafeLoader)) is not None:
            raise ValueError("an alias is part of what it stands for")
        return yaml.safe_load(text)
    except UNREADABLE as error:
        reason = (isinstance(error, OSError) and error.strerror) or error
        raise InvalidValueError(f"{what}: cannot read {path}: {reason}") from error
