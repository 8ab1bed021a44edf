"""Policies as a user writes them down: a name, or the place of a class, with parameters.

| text | meaning |
|---|---|
| `late_fusion` | a registered policy |
| `late_fusion(delayed=replay, hits=2)` | the same with parameters, see `coopsim.config.spec` |
| `mypackage.module:MyTracker` | a class of an installed package |
| `path/to/file.py:MyTracker` | a class in a file that imports nothing from its own folder |
"""

from __future__ import annotations

import difflib
import importlib
import pkgutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import coopsim
from coopsim.catalog import POLICIES
from coopsim.config.spec import instantiate, parse_spec, spell_spec
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy

SOURCE = "__coopsim_source__"
"""Name under which a module that was made by `load_source` has its text."""

_ACCEPTED = "name, name(parameter=value, ...) (in a YAML list in quotes), module:Class or file.py:Class"


@dataclass(frozen=True, slots=True)
class PolicySpec:
    """A policy and its parameters, as plain data that can be sent to another process or machine.

    Attributes:
        target: a registered name, `module:Class` or `file.py:Class`.
        parameters: by name.
        source: text of the file, read once so that all runs use one version of it; None without a file.
    """

    target: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    source: str | None = None

    @classmethod
    def parse(cls, text: str) -> PolicySpec:
        """Parse the text of a user.

        Raises:
            InvalidValueError: the text has another shape, or its file cannot be read.
        """
        target, parameters = parse_spec("policy", text, _ACCEPTED)
        if target.endswith(".py"):
            raise InvalidValueError(f"policy {text!r} must name the class in that file, as {target}:MyTracker")
        return cls(target, parameters, _source(target) if _is_file(target) else None)

    @property
    def text(self) -> str:
        """The one spelling of the policy with its parameters, as it stands in results."""
        return spell_spec(self.target, self.parameters)

    @property
    def place(self) -> str:
        """Module or file of the class; empty for a registered name."""
        return self.target.rpartition(":")[0]

    def policy_class(self) -> type[Policy]:
        """Look up the policy's class.

        Raises:
            UnknownNameError: no class has that name; the message lists the close ones.
            InvalidValueError: the module cannot be imported, or the name in it is not a policy class.
        """
        if ":" not in self.target:
            return POLICIES.get(self.target)
        place, name = self.target.rsplit(":", 1)
        module = _import(place) if self.source is None else load_source(place, self.source)
        found = getattr(module, name, None)
        if found is None:
            known = [each for each in vars(module) if _is_policy(module, each)]
            raise UnknownNameError("policy", name, known, f"in {place}")
        if not (isinstance(found, type) and issubclass(found, coopsim.Policy)):
            raise InvalidValueError(
                f"policy {self.target!r} must be a class derived from coopsim.Policy, got {found!r}"
            )
        return found

    def make(self) -> Policy:
        """Make the policy with its parameters.

        Raises:
            CoopsimError: there is no such policy or parameter, or a value is not accepted.
        """
        try:
            return instantiate("policy", self.target, self.policy_class(), self.parameters)
        except CoopsimError:
            raise
        except Exception as error:  # a user's class may raise anything
            raise InvalidValueError(f"policy {self.text!r} cannot be made: {_describe(error)}") from error


def names_code(text: str) -> bool:
    """Return whether a policy's text is the place of a class, whose module or file is run, and no registered name."""
    return ":" in text.partition("(")[0]


def _is_file(target: str) -> bool:
    return target.rpartition(":")[0].endswith(".py")


def _source(target: str) -> str:
    path = target.rpartition(":")[0]
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InvalidValueError(f"policy {target!r}: cannot read {path}: {reason}") from error


def _import(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = str(error.name)
        close = difflib.get_close_matches(missing, _modules_beside(missing), n=3, cutoff=0.6)
        hint = f" Did you mean {' or '.join(map(repr, close))}?" if close else ""
        message = f"policy module {name!r}: there is no module {missing!r}.{hint}"
        raise InvalidValueError(f"{message} Accepted: modules that are installed or on PYTHONPATH") from error
    except Exception as error:  # a user's module may raise anything when it is imported
        raise InvalidValueError(f"policy module {name!r} cannot be imported: {_describe(error)}") from error


def _modules_beside(name: str) -> list[str]:
    """Return the modules next to the one called `name`, for suggestions."""
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
    sys.modules[module.__name__] = module  # dataclasses look for the names of annotations there
    try:
        exec(compile(source, path, "exec"), module.__dict__)
    except CoopsimError:
        raise
    except Exception as error:  # a user's file may raise anything
        raise InvalidValueError(f"policy file {path} cannot be loaded: {_describe(error)}") from error
    return module


def _describe(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _is_policy(module: ModuleType, name: str) -> bool:
    found = getattr(module, name)
    own = isinstance(found, type) and found.__module__ == module.__name__
    return own and issubclass(found, coopsim.Policy)
