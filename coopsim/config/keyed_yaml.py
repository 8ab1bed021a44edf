"""YAML files of known keys, whose errors name the file and the line."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import EllipsisType
from typing import Any, TypeAlias

import yaml

from coopsim.config.located_yaml import Entry
from coopsim.config.mappings import UNREADABLE, alias_in_itself
from coopsim.errors import CoopsimError, UnknownNameError

Known: TypeAlias = Mapping[str, "Known | EllipsisType | None"]
"""Keys that there may be, and below each: those of its mapping, ... for whatever keys it has, None for a value."""


KeyPath: TypeAlias = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class KeyedYaml:
    """What a file says.

    Attributes:
        path: of the file.
        root: all of it, each value with its line.
        content: its keys and values.
        lines: where each key stands, from 1, by the keys on the way to it.
        error: the class of errors about it.
    """

    path: Path
    root: Entry
    content: Mapping[str, Any]
    lines: Mapping[KeyPath, int]
    error: type[CoopsimError]

    def wrong(self, message: str, *key: str) -> CoopsimError:
        """An error about a key that the file has, given by the keys on the way to it, or about what it has not."""
        return _at(self.error, self.path, self.lines.get(key, 1), message)

    def blame(self, error: CoopsimError, beside: Collection[str] = (), within: KeyPath = ()) -> CoopsimError | None:
        """The same error with the file and the line of the key that it names; None if it names no key of the file.

        Of keys with the same name it is the outermost.

        Args:
            error: whose message begins with what it is about.
            beside: keys that were given in another way and went before the file's.
            within: keys on the way to the mapping that the error is about.
        """
        inside = [key for key in self.lines if key[: len(within)] == within and key[-1] not in beside]
        for key in sorted(inside, key=lambda key: (-len(key[-1]), len(key))):
            if re.match(rf"(unknown )?(option ')?{re.escape(key[-1])}(?!\w)", str(error)):
                return self.wrong(str(error), *key)
        return None


def read_keyed_yaml(
    path: Path, known: Known, error: type[CoopsimError], *, may_be_value: Collection[str] = ()
) -> KeyedYaml:
    """Read a file and check its keys; values are checked by whoever takes them.

    Args:
        path: of the file.
        known: keys that there may be.
        error: raised for whatever is wrong with the file.
        may_be_value: keys of mappings that may be a single value instead.
    """
    try:
        text = path.read_text(encoding="utf-8")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if (circular := alias_in_itself(node)) is not None:
            raise _at(error, path, circular.start_mark.line + 1, "an alias is part of what it stands for")
        content = yaml.safe_load(text)
    except yaml.MarkedYAMLError as broken:
        line = broken.problem_mark.line + 1 if broken.problem_mark else 1
        raise _at(error, path, line, f"this is no YAML: {broken.problem}") from broken
    except UNREADABLE as broken:
        raise error(f"{path}: cannot be read: {broken}") from broken
    lines: dict[KeyPath, int] = {}

    top = known

    def check(section: Entry, known: Known | EllipsisType, way: KeyPath = ()) -> None:
        here: Known | None = None if isinstance(known, EllipsisType) else known
        accepted = "any" if here is None else ", ".join(sorted(here))
        for name, entry in section.named(f"Accepted: {accepted}").items():
            if here is not None and name not in here:
                raise entry.error(_where_it_belongs(name, top) or str(UnknownNameError("key", name, here)))
            lines[*way, name] = entry.line
            below = None if here is None else here[name]
            if below is not None and not (name in may_be_value and isinstance(entry.node, yaml.ScalarNode)):
                check(entry, below, (*way, name))

    root = Entry(path, node, "file", 1, error)
    check(root, known)
    return KeyedYaml(path, root, content, lines, error)


def _where_it_belongs(name: str, top: Known) -> str | None:
    """A hint for whoever put a key that there is into another section."""
    if name in top:
        return f"{name} belongs to the top of the file, not below another key"
    for section, keys in top.items():
        if isinstance(keys, Mapping) and name in keys:
            return f"{name} belongs below {section}"
    return None


def _at(error: type[CoopsimError], path: Path, line: int, message: str) -> CoopsimError:
    return error(f"{path}:{line}: {message}")
