"""YAML whose every value knows its file and line, so that errors can say where something is wrong."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from coopsim.errors import CoopsimError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_finite_number


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """A value in a file.

    Attributes:
        file: its path.
        node: the value, as YAML's composer found it.
        name: its key, or that of the list that it is in.
        line: of the key, from 1.
        kind: of the errors about the file. Every method raises one if the value is not what it asks for, with the
            file, the line and the name.
    """

    file: Path
    node: yaml.Node
    name: str
    line: int
    kind: type[CoopsimError]

    @property
    def value(self) -> Any:
        """As plain Python."""
        loader = yaml.SafeLoader("")
        try:
            return loader.construct_document(self.node)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise self.error(f"{self.name} cannot be read: {error}") from error
        finally:
            loader.dispose()

    def error(self, message: str) -> CoopsimError:
        """One that says where."""
        return self.kind(f"{self.file}:{self.line}: {message}")

    def fields(self, required: Collection[str], optional: Collection[str] = ()) -> dict[str, Entry]:
        """Keys and values; all that are `required` are there, and none that is unknown."""
        known = [*required, *optional]
        found = self.named(f"Accepted: {', '.join(sorted(known))}")
        for name, entry in found.items():
            if name not in known:
                raise entry.error(str(UnknownNameError(f"key in {self.name}", name, known)))
        for name in required:
            if name not in found:
                raise self.error(f"{name} is missing in {self.name}. Accepted: {', '.join(sorted(known))}")
        return found

    def named(self, hint: str = "Accepted: names of your own") -> dict[str, Entry]:
        """Keys, which may be any, and values."""
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f"{self.name}: expected keys and values. {hint}")
        found: dict[str, Entry] = {}
        for key, value in self.node.value:
            name, line = str(key.value), key.start_mark.line + 1
            entry = Entry(self.file, value, name, line, self.kind)
            if name in found:
                raise entry.error(f"{name} is there twice")
            found[name] = entry
        return found

    def entries(self, of: str = "") -> list[Entry]:
        """What a list consists of; `of` says it in words, as " of names"."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f"{self.name} must be a list{of}, got {self._shown()}")
        return [Entry(self.file, item, self.name, item.start_mark.line + 1, self.kind) for item in self.node.value]

    def checked(self, check: Callable[..., None], *limits: Any) -> Any:
        """The value, if a function of `coopsim.support.checks` takes it after `limits`."""
        value = self.value
        try:
            check(*limits, **{self.name: value})
        except CoopsimError as error:
            raise self.error(str(error)) from error
        return value

    def text(self) -> str:
        """A name; a number is one, too."""
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.error(f"{self.name} must be a name, got {self._shown()}")
        return str(self.node.value)

    def choice(self, accepted: Iterable[str], kind: str | None = None) -> str:
        """One of some names."""
        name = self.text()
        try:
            require_choice(kind or self.name, name, accepted)
        except CoopsimError as error:
            raise self.error(str(error)) from error
        return name

    def numbers(self, count: int | None = None) -> list[float]:
        """A list of finite numbers, of a length if one is given."""
        items = self.entries()
        if count is not None and len(items) != count:
            raise self.error(f"{self.name} must be {count} numbers, got {self._shown()}")
        return [float(item.checked(require_finite_number)) for item in items]

    def point(self) -> Floats:
        """A place (2,) m."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f"{self.name} must have points [x, y], got {self._shown()}")
        return np.array(self.numbers(2))

    def points(self, least: int) -> Floats:
        """Places (N, 2) m, at least so many."""
        items = self.entries()
        if len(items) < least:
            raise self.error(f"{self.name} must be at least {least} points [x, y], got {len(items)}")
        return np.array([item.point() for item in items])

    def _shown(self) -> str:
        text = repr(self.value)
        return text if len(text) <= 60 else f"{text[:57]}..."
