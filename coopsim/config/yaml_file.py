"""YAML files whose every value knows its file and line, so that errors can say where something is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml
from yaml.constructor import ConstructorError

from coopsim.errors import CoopsimError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_finite_number

PATH_KEYS = ("channel", "lidar", "localization", "path", "pattern", "playback")
"""Keys whose texts may be the path of a file."""

_ROOT = "file"


class Section(dict[str, Any]):
    """A mapping from a file: plain data, and where it is written.

    Args:
        content: keys and values; a section that is made of nothing else is in no file.
        file: path of the file.
        line: line of the mapping's own key, from 1.
        lines: lines of the keys.
    """

    def __init__(
        self,
        content: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
        file: Path = Path(),
        line: int = 0,
        lines: Mapping[str, int] | None = None,
    ) -> None:
        super().__init__(content)
        self.file, self.line, self._lines = file, line, lines or {}

    def place(self, key: str | None = None) -> str | None:
        """Return "file:line" of a key, or of the section if it has no such key; None: it is in no file."""
        return f"{self.file}:{self._lines.get(key or '', self.line)}" if self.line else None

    def blame(self, error: CoopsimError, overridden: Collection[str] = ()) -> str | None:
        """Return "file:line" of the key that an error's message begins with, here or in a section within.

        Of keys with the same name, it is the outermost; None: the message begins with no key.

        Args:
            error: the error.
            overridden: keys whose values were not taken from the file.
        """
        level, keys = [self], list[tuple[str, Section]]()
        while level:
            keys += [(key, section) for section in level for key in section if key not in overridden]
            level = [inner for section in level for inner in section.values() if isinstance(inner, Section)]
        for key, section in sorted(keys, key=lambda each: -len(each[0])):
            if re.match(rf"(unknown )?(option ')?{re.escape(key)}(?!\w)", str(error)):
                return section.place(key)
        return None

    def with_paths(self) -> Self:
        """Make texts under `PATH_KEYS`, at any depth, relative to the file's folder if they name a file there."""
        for key, value in self.items():
            if isinstance(value, Section):
                value.with_paths()
            elif key in PATH_KEYS and isinstance(value, str):
                self[key] = path_from(self.file.parent, value)
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A value in a file. Methods that ask for a kind of value raise an error with file, line and name for any other.

    Attributes:
        file: path of the file.
        node: the value, as composed by YAML.
        name: its key, or the key of the list that it is in.
        line: line of the key, from 1.
        kind: class of the errors about the file.
    """

    file: Path
    node: yaml.Node
    name: str
    line: int
    kind: type[CoopsimError]

    @property
    def value(self) -> Any:
        """The value as plain Python; mappings are of the class `Section`."""
        return self._plain(())

    def _plain(self, above: tuple[yaml.Node, ...]) -> Any:
        if self.node in above:
            raise self.error("an alias is part of what it stands for")
        above = (*above, self.node)
        if isinstance(self.node, yaml.MappingNode):
            named = self.named()
            content = {name: entry._plain(above) for name, entry in named.items()}
            return Section(content, self.file, self.line, {name: entry.line for name, entry in named.items()})
        if isinstance(self.node, yaml.SequenceNode):
            return [item._plain(above) for item in self.entries()]
        try:
            return yaml.SafeLoader("").construct_document(self.node)
        except yaml.MarkedYAMLError as error:
            raise self.error(f"this is no YAML: {error.problem}") from error
        except ValueError as error:
            raise self.error(f"{self.name} cannot be read: {error}") from error

    def error(self, message: str) -> CoopsimError:
        """Return an error with file and line."""
        return self.kind(message).at(f"{self.file}:{self.line}")

    def fields(
        self, required: Collection[str], optional: Collection[str] = (), elsewhere: Mapping[str, str] | None = None
    ) -> dict[str, Entry]:
        """Return the values by key; raise an error if a required key is missing, or a key is unknown.

        Args:
            required: keys that must be there.
            optional: keys that may be there.
            elsewhere: keys that belong elsewhere in the file, and where: "below options".
        """
        known = [*required, *optional]
        found = self.named(f"Accepted: {', '.join(sorted(known))}")
        where = "" if self.name == _ROOT else f" in {self.name}"
        for name, entry in found.items():
            if name in known:
                continue
            if elsewhere and name in elsewhere:
                raise entry.error(f"{name} belongs {elsewhere[name]}")
            raise entry.error(str(UnknownNameError(f"key{where}", name, known)))
        for name in required:
            if name not in found:
                raise self.error(f"{name} is missing in {self.name}. Accepted: {', '.join(sorted(known))}")
        return found

    def named(self, hint: str = "Accepted: names of your own") -> dict[str, Entry]:
        """Return the values of a mapping with any keys, by key."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f"{self.name}: expected keys and values. {hint}")
        return {
            str(key.value): Entry(self.file, value, str(key.value), key.start_mark.line + 1, self.kind)
            for key, value in self.node.value
        }

    def entries(self, of: str = "") -> list[Entry]:
        """Return the items of a list; `of` says in words what they are, as " of names"."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f"{self.name} must be a list{of}, got {self._shown()}")
        return [Entry(self.file, item, self.name, item.start_mark.line + 1, self.kind) for item in self.node.value]

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
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error(f"{self.name} must be a name, got {self._shown()}")
        return str(self.node.value)

    def choice(self, accepted: Iterable[str], kind: str | None = None) -> str:
        """Return one of the accepted names."""
        name = self.text()
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
        return [float(item.checked(require_finite_number)) for item in items]

    def point(self) -> Floats:
        """Return a point (2,) m."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f"{self.name} must have points [x, y], got {self._shown()}")
        return np.array(self.numbers(2))

    def points(self, least: int) -> Floats:
        """Return points (N, 2) m, N >= `least`."""
        items = self.entries()
        if len(items) < least:
            raise self.error(f"{self.name} must be at least {least} points [x, y], got {len(items)}")
        return np.array([item.point() for item in items])

    def _shown(self) -> str:
        text = repr(self.value)
        return text if len(text) <= 60 else f"{text[:57]}..."


def read_yaml(path: Path, kind: type[CoopsimError]) -> Entry:
    """Read a file; the result is its root, by the name "file".

    Raises:
        CoopsimError: of the class `kind`: the file cannot be read, is no YAML, or has a key twice.
    """
    try:
        node = yaml.compose(path.read_text(encoding="utf-8"), Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        what = "" if isinstance(error, ConstructorError) else "this is no YAML: "
        raise kind(f"{what}{error.problem}").at(f"{path}:{line}") from error
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:  # not UTF-8, or 1000 brackets, too
        raise kind(f"cannot read {path}: {(isinstance(error, OSError) and error.strerror) or error}") from error
    return Entry(path, node or yaml.ScalarNode("tag:yaml.org,2002:null", ""), _ROOT, 1, kind)


def path_from(folder: str | Path, path: str) -> str:
    """Return the path of the file in that folder if there is one, else the path as it is."""
    return str(found) if (found := Path(folder, path)).is_file() else path


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # yaml has no types
    """A safe loader that refuses repeated keys, and merges `<<` into the mapping that has it."""

    def compose_mapping_node(self, anchor: str | None) -> yaml.Node:
        node, names = super().compose_mapping_node(anchor), set[str]()
        for key, _ in node.value:
            if (name := str(key.value)) in names:
                raise ConstructorError(problem=f"{name} is there twice", problem_mark=key.start_mark)
            names.add(name)
        self.flatten_mapping(node)  # the mapping's own keys follow the merged ones, and override them
        node.value = list({str(key.value): (key, value) for key, value in node.value}.values())
        return node
