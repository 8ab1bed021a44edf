"""Policies as a user writes them down: a name, or where a class is, and parameters if there are any.

| text | what it is |
|---|---|
| `late_fusion` | a registered policy |
| `late_fusion(delayed=replay, hits=2)` | the same with parameters: numbers, True, False, None, texts, lists of these |
| `mypackage.module:MyTracker` | a class of an installed package |
| `path/to/file.py:MyTracker` | a class in a file, which has to stand by itself |
"""

from __future__ import annotations

import ast
import difflib
import importlib
import pkgutil
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import coopsim
from coopsim.catalog import POLICIES, instantiate
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy

SOURCE = "__coopsim_source__"
"""Name under which a module that was made by `load_source` has its text."""

_SHAPE = re.compile(r"(?P<target>[^()\s][^()]*?)\s*(?:\((?P<parameters>.*)\))?", re.DOTALL)


@dataclass(frozen=True, slots=True)
class PolicySpec:
    """Which policy, and with which parameters; plain data, so that it can be sent to another process or machine.

    Attributes:
        target: a registered name, `module:Class` or `file.py:Class`.
        parameters: by name.
        source: text of the file, read once, so that a run is of one version of it; None without a file.
    """

    target: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    source: str | None = None

    @classmethod
    def parse(cls, text: str) -> PolicySpec:
        """Read what a user wrote.

        Raises:
            InvalidValueError: it has another shape, or its file cannot be read.
        """
        match = _SHAPE.fullmatch(text.strip()) if isinstance(text, str) else None
        if match is None:
            raise InvalidValueError(
                "policy must be name, name(parameter=value, ...) (in a YAML list in quotes), module:Class or "
                f"file.py:Class, got {text!r}"
            )
        target = match["target"]
        if target.endswith(".py"):
            raise InvalidValueError(f"policy {text!r} must name the class in that file, as {target}:MyTracker")
        return cls(target, _parameters(text, match["parameters"] or ""), _source(target) if _is_file(target) else None)

    @property
    def text(self) -> str:
        """As it stands in results: one spelling for each policy with its parameters."""
        given = ", ".join(f"{name}={_spelled(value)}" for name, value in sorted(self.parameters.items()))
        return f"{self.target}({given})" if given else self.target

    def policy_class(self) -> type[Policy]:
        """The class.

        Raises:
            UnknownNameError: there is none of that name; the message lists the close ones.
            InvalidValueError: the module cannot be imported, or what it has there is no policy.
        """
        if ":" not in self.target:
            return POLICIES.get(self.target)
        place, name = self.target.rsplit(":", 1)
        module = _import(place) if self.source is None else load_source(place, self.source)
        found = getattr(module, name, None)
        if found is None:
            raise UnknownNameError(
                f"policy in {place}", name, [each for each in vars(module) if _is_policy(module, each)]
            )
        if not (isinstance(found, type) and issubclass(found, coopsim.Policy)):
            raise InvalidValueError(
                f"policy {self.target!r} must be a class derived from coopsim.Policy, got {found!r}"
            )
        return found

    def make(self) -> Policy:
        """A policy, made with the parameters.

        Raises:
            CoopsimError: there is no such policy or parameter, or a value is not accepted.
        """
        try:
            return instantiate(self.target, self.policy_class(), self.parameters)
        except CoopsimError:
            raise
        except Exception as error:  # whatever a user's class raises
            raise InvalidValueError(f"policy {self.text!r} cannot be made: {_told(error)}") from error


def split_policies(text: str) -> tuple[str, ...]:
    """Policies with commas between them; commas between brackets belong to parameters."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return tuple(part.strip() for part in parts)


def _is_file(target: str) -> bool:
    return target.rpartition(":")[0].endswith(".py")


def _source(target: str) -> str:
    path = target.rpartition(":")[0]
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InvalidValueError(f"policy {target!r}: cannot read {path}: {reason}") from error


def _parameters(text: str, given: str) -> dict[str, Any]:
    try:
        call = ast.parse(f"policy({given})", mode="eval").body
        if not isinstance(call, ast.Call) or call.args or any(keyword.arg is None for keyword in call.keywords):
            raise ValueError("a parameter has no name")
        return {str(keyword.arg): _value(keyword.value) for keyword in call.keywords}
    except (SyntaxError, ValueError) as error:
        raise InvalidValueError(
            f"policy {text!r}: parameters must be name=value with commas between them, the values numbers, True, "
            f"False, None, texts or lists of these, got {given!r}"
        ) from error


def _value(node: ast.expr) -> Any:
    if isinstance(node, ast.Name):  # a text need not be quoted: delayed=replay
        return node.id
    if isinstance(node, (ast.List, ast.Tuple)):
        return [_value(each) for each in node.elts]
    value = ast.literal_eval(node)
    if not (value is None or isinstance(value, (bool, int, float, str))):  # of a set, the order is not always the same
        raise ValueError(f"{value!r} is nothing that can be spelled")
    return value


def _spelled(value: Any) -> str:
    if isinstance(value, str) and value.isidentifier() and value not in ("True", "False", "None"):
        return value
    return f"[{', '.join(map(_spelled, value))}]" if isinstance(value, list) else repr(value)


def _import(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = str(error.name)
        close = difflib.get_close_matches(missing, _modules_beside(missing), n=3, cutoff=0.6)
        hint = f" Did you mean {' or '.join(map(repr, close))}?" if close else ""
        told = f"policy module {name!r}: there is no module {missing!r}.{hint}"
        raise InvalidValueError(f"{told} Accepted: what is installed or on PYTHONPATH") from error
    except Exception as error:  # whatever a user's module raises when it is imported
        raise InvalidValueError(f"policy module {name!r} cannot be imported: {_told(error)}") from error


def _modules_beside(name: str) -> list[str]:
    """Names that the last part of `name` could have been meant for."""
    package, _, _ = name.rpartition(".")
    path = getattr(sys.modules.get(package), "__path__", None)
    return [f"{package}.{each.name}" if package else each.name for each in pkgutil.iter_modules(path)]


@cache
def load_source(path: str, source: str) -> ModuleType:
    """Execute the text of a file as a module, once per process; it cannot import other files of its folder.

    Raises:
        InvalidValueError: the text raises an exception.
    """
    module = ModuleType(f"coopsim_policy_{Path(path).stem}")
    module.__file__ = path
    module.__dict__[SOURCE] = source
    sys.modules[module.__name__] = module  # where dataclasses look for the names in annotations
    try:
        exec(compile(source, path, "exec"), module.__dict__)
    except CoopsimError:
        raise
    except Exception as error:  # whatever a user's file raises
        raise InvalidValueError(f"policy file {path} cannot be loaded: {_told(error)}") from error
    return module


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _is_policy(module: ModuleType, name: str) -> bool:
    found = getattr(module, name)
    own = isinstance(found, type) and found.__module__ == module.__name__
    return own and issubclass(found, coopsim.Policy)
