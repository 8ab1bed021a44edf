"""YAML files whose every value knows its file and line, so that errors can say where something is wrong."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import yaml
from yaml.constructor import ConstructorError, SafeConstructor

from coopsim.config.checked_entry import ROOT, Entry
from coopsim.errors import CoopsimError

PATH_KEYS = ("channel", "lidar", "localization", "path", "pattern", "playback")
"""Keys whose texts may be the path of a file."""


_MOST_REPEATED = 100_000


class Section(dict[str, Any]):
    """A mapping from a file: plain data, and the `file`, the `line` of its own key and the `lines` of its keys, from 1.

    A section that is made of nothing else is in no file.
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

        Of keys with the same name, it is the outermost; None: the message begins with no key. Keys that are
        `overridden` have values of elsewhere.
        """
        level, keys = [self], list[tuple[str, Section]]()
        while level:
            keys += [(key, section) for section in level for key in section if key not in overridden]
            level = [inner for section in level for inner in section.values() if isinstance(inner, Section)]
        for key, section in sorted(keys, key=lambda each: -len(each[0])):
            if re.match(rf"(unknown )?(option ')?{re.escape(key)}(?!\w)", str(error)):
                return section.place(key)
        return None

    def rename(self, key: str, to: str) -> None:
        """Move the value of a key, and its line, to another key."""
        self[to] = self.pop(key)
        self._lines = {to if each == key else each: line for each, line in self._lines.items()}

    def with_paths(self) -> Self:
        """Make texts under `PATH_KEYS`, at any depth, relative to the file's folder if they name a file there."""
        for key, value in self.items():
            if isinstance(value, Section):
                value.with_paths()
            elif key in PATH_KEYS and isinstance(value, str):
                self[key] = path_from(self.file.parent, value)
        return self


class FileEntry(Entry):
    """A value in a file; errors begin with file and line.

    Args:
        file: path of the file.
        node: the value, as composed by YAML.
        name: see `Entry`.
        line: line of the key, from 1.
        kind: see `Entry`.
    """

    __slots__ = ("file", "line", "node")

    def __init__(
        self,
        file: Path,
        node: yaml.Node,
        name: str,
        line: int,
        kind: type[CoopsimError],
    ) -> None:
        super().__init__(name, kind)
        self.file, self.node, self.line = file, node, line

    @property
    def value(self) -> Any:
        """The value as plain Python; mappings are of the class `Section`."""
        return self._plain(())

    def _plain(self, above: tuple[yaml.Node, ...]) -> Any:
        if self.node in above:
            raise self.error("an alias is part of what it stands for")
        above = (*above, self.node)
        named, items = self.pairs(), self.items()
        if named is not None:
            content = {name: entry._plain(above) for name, entry in named.items()}
            return Section(content, self.file, self.line, {name: entry.line for name, entry in named.items()})
        if items is not None:
            return [item._plain(above) for item in items]
        try:
            return SafeConstructor().construct_document(self.node)
        except yaml.MarkedYAMLError as error:
            raise self.error(f"this is no YAML: {error.problem}") from error
        except ValueError as error:
            raise self.error(f"{self.name} cannot be read: {error}") from error

    @property
    def spot(self) -> str:
        return f"line {self.line}"

    def error(self, message: str) -> CoopsimError:
        return self.kind(message).at(f"{self.file}:{self.line}")

    def pairs(self) -> dict[str, FileEntry] | None:
        if not isinstance(self.node, yaml.MappingNode):
            return None
        return {
            str(key.value): self._within(value, str(key.value), key.start_mark.line + 1)
            for key, value in self.node.value
        }

    def items(self) -> list[FileEntry] | None:
        if not isinstance(self.node, yaml.SequenceNode):
            return None
        return [self._within(item, self.name, item.start_mark.line + 1) for item in self.node.value]

    def part(self, *keys: str | int) -> FileEntry:
        found = self
        for key in keys:
            items, named = found.items(), found.pairs()
            if items is not None and isinstance(key, int):
                found = items[key]
            elif named is not None and key in named:
                found = named[str(key)]
        return found

    def scalar(self) -> str | None:
        if not isinstance(self.node, yaml.ScalarNode):
            return None
        return str(self.node.value)

    def _within(self, node: yaml.Node, name: str, line: int) -> FileEntry:
        return FileEntry(self.file, node, name, line, self.kind)


def read_yaml(path: Path, kind: type[CoopsimError]) -> FileEntry:
    """Read a file; the result is its root, by the name "file". Raises `kind` if it is unreadable, no YAML, or repeats a
    key.
    """
    try:
        node = yaml.compose(path.read_text(encoding="utf-8"), Loader=_Loader)
        if node is not None:
            refuse_many_aliases(node)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        what = "" if isinstance(error, ConstructorError) else "this is no YAML: "
        raise kind(f"{what}{error.problem}").at(f"{path}:{line}") from error
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:  # not UTF-8, or 1000 brackets, too
        raise kind(f"cannot read {path}: {(isinstance(error, OSError) and error.strerror) or error}") from error
    return FileEntry(path, node or yaml.ScalarNode("tag:yaml.org,2002:null", ""), ROOT, 1, kind)


def refuse_many_aliases(root: yaml.Node) -> None:
    """Refuse a document whose aliases stand for so many values that to expand them takes all memory."""
    sizes: dict[yaml.Node, int] = {}

    def size(node: yaml.Node) -> int:
        if node not in sizes:
            sizes[node] = 0  # of an alias that is part of what it stands for
            parts = node.value if isinstance(node, yaml.CollectionNode) else ()
            parts = itertools.chain.from_iterable(parts) if isinstance(node, yaml.MappingNode) else parts
            sizes[node] = 1 + sum(map(size, parts))
        return sizes[node]

    repeated = size(root) - len(sizes)
    if repeated > _MOST_REPEATED:
        problem = f"aliases must stand for at most {_MOST_REPEATED} values, they stand for {repeated:.3g}"
        raise ConstructorError(problem=problem, problem_mark=root.start_mark)


def load_bounded(loader: Any) -> Any:
    """Return the one document of a PyYAML loader as plain data; raises as that does, and for too many aliases."""
    node = loader.get_single_node()
    if node is None:
        return None
    refuse_many_aliases(node)
    return loader.construct_document(node)


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


_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.>+-]*")
_RESOLVER = yaml.resolver.Resolver()


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return a document. Mappings are blocks, lists of lists or mappings have a line for each item, others one line.

    Args:
        content: mappings, lists, texts, numbers, flags and None; numbers read back to the same bits.
    """
    return "\n".join(_block(content, "")) + "\n"


def _block(value: Any, indent: str) -> Iterator[str]:
    """Yield the lines of a mapping or list."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if _is_block(item):
                yield f"{indent}{_scalar(str(key))}:"
                yield from _block(item, indent + "  ")
            else:
                yield f"{indent}{_scalar(str(key))}: {_flow(item)}"
    else:
        yield from (f"{indent}- {_flow(item)}" for item in value)


def _is_block(value: Any) -> bool:
    if isinstance(value, Mapping):
        return bool(value)
    return isinstance(value, (list, tuple)) and any(isinstance(item, (list, tuple, Mapping)) for item in value)


def _flow(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_scalar(str(key))}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, float):
        return _float(float(value))
    if isinstance(value, str):
        return value if _is_plain(value) else json.dumps(value, ensure_ascii=False)
    return str(value)


def _float(value: float) -> str:
    """Return the shortest text of a number that reads back to it; YAML asks for a point before an exponent."""
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _is_plain(text: str) -> bool:
    """Return whether a text needs no quotes: it is a word, and none of YAML's own, as "no"."""
    resolved = _RESOLVER.resolve(yaml.ScalarNode, text, (True, False))
    return _PLAIN.fullmatch(text) is not None and resolved == "tag:yaml.org,2002:str"
