"""Classes of users by place: `module:Class` of an installed package, or `file.py:Class`.

A file is executed as a module of its own, from a text that is read once. It may import modules and packages beside it.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import pkgutil
import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError, close_names

_Base = TypeVar("_Base")

SOURCE = "__coopsim_source__"
"""Name under which a module that was made by `load_source` has its text."""

_PLACE = re.compile(r"[\w./~-]:[^\W\d]\w*")

_FOLDERS: list[str] = []
"""Folders of users' files, which `load_source` has put at the end of Python's path."""


def class_at(kind: str, target: str, base: type[_Base], source: str | None = None) -> type[_Base]:
    """Return the class at a place, `module:Class` or `file.py:Class`.

    Args:
        kind: the class's, in the singular, for error messages ("policy").
        target: the place.
        base: the class that it must be derived from.
        source: text of the file; None: it is read now.

    Raises:
        CoopsimError: the module or file cannot be read or run, or has no such class.
    """
    place, name = target.rsplit(":", 1)
    if not name.isidentifier():  # before anything is run: `names_code` knows no such places
        raise InvalidValueError(f"{kind} {target!r} must name a class, as module:Class or file.py:Class")
    if source is None and names_file(target):
        source = read_source(target, kind)
    module = _import(place, kind) if source is None else load_source(place, source)
    found = getattr(module, name, None)
    if found is None:
        known = [each for each in vars(module) if _is_own(module, each, base)]
        raise UnknownNameError(kind, name, known, f"in {place}")
    if not (isinstance(found, type) and issubclass(found, base)):
        raise InvalidValueError(f"{kind} {target!r} must be a class derived from {_public_name(base)}, got {found!r}")
    return found


def names_code(text: str) -> bool:
    """Return whether a part's text, or a parameter in it, is the place of a class, whose module or file is run."""
    return _PLACE.search(text) is not None


def code_in(content: Any) -> str | None:
    """Return the first text in plain data, keys among it, that names code to run; None: there is none."""
    if isinstance(content, str):
        return content if names_code(content) else None
    if isinstance(content, Mapping):
        content = [*content, *content.values()]
    parts = content if isinstance(content, (list, tuple)) else ()
    return next((found for part in parts if (found := code_in(part)) is not None), None)


def names_file(target: str) -> bool:
    """Return whether a place is that of a file, `file.py:Class`."""
    return target.rpartition(":")[0].endswith(".py")


def read_source(target: str, kind: str = "policy") -> str:
    """Return the text of the file of a place. Raises `InvalidValueError` where it cannot be read."""
    path = target.rpartition(":")[0]
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InvalidValueError(f"{kind} {target!r}: cannot read {path}: {reason}") from error


def _import(name: str, kind: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = str(error.name)
        close = close_names(missing, _sibling_modules(missing))
        hint = f" Did you mean {' or '.join(map(repr, close))}?" if close else ""
        message = f"{kind} module {name!r}: there is no module {missing!r}.{hint}"
        raise InvalidValueError(f"{message} Accepted: modules that are installed or on PYTHONPATH") from error
    except Exception as error:  # a user's module may raise anything when it is imported
        raise InvalidValueError(f"{kind} module {name!r} cannot be imported: {describe(error)}") from error


def _sibling_modules(name: str) -> list[str]:
    """Return the modules next to the one called `name`, for suggestions."""
    package, _, _ = name.rpartition(".")
    path = getattr(sys.modules.get(package), "__path__", None)
    return [f"{package}.{each.name}" if package else each.name for each in pkgutil.iter_modules(path)]


@cache
def load_source(path: str, source: str) -> ModuleType:
    """Execute the text of a file as a module, once per process.

    Modules beside the file are found behind all others: none of them takes the place of an installed one.

    Raises:
        InvalidValueError: the text raises an exception, or imports a module of its folder whose name another folder's
            file has taken in this process.
    """
    module = ModuleType(f"coopsim_policy_{Path(path).stem}")
    module.__file__ = path
    module.__dict__[SOURCE] = source
    sys.modules[module.__name__] = module  # dataclasses look for the names of annotations there
    _add_to_path(str(Path(path).resolve().parent))
    try:
        exec(compile(source, path, "exec"), module.__dict__)
    except CoopsimError:
        raise
    except Exception as error:  # a user's file may raise anything
        raise InvalidValueError(f"policy file {path} cannot be loaded: {describe(error)}") from error
    _refuse_other_folders(path, source)
    return module


def modules_beside(path: str | Path, source: str) -> list[Path]:
    """Return the modules and packages beside a file that its text imports, and those that these import, sorted.

    Nothing is executed. A package is the path of its folder. A name that is installed is not beside the file.
    """
    found: dict[str, Path] = {}
    texts, folder = [source], Path(path).resolve().parent
    while texts:
        for name in _imports(texts.pop()):
            place = next((each for each in (folder / f"{name}.py", folder / name) if each.exists()), None)
            if place is None or name in found or not _is_beside(name, folder):
                continue
            found[name] = place
            files = [place] if place.is_file() else sorted(place.rglob("*.py"))
            texts += [each.read_text(encoding="utf-8", errors="replace") for each in files]
    return sorted(found.values())


def _add_to_path(folder: str) -> None:
    if folder not in sys.path:
        sys.path.append(folder)
        _FOLDERS.append(folder)
        importlib.invalidate_caches()


def _refuse_other_folders(path: str, source: str) -> None:
    """Refuse a module that has the name of one beside the file, and is of the folder of another user's file."""
    own = Path(path).resolve().parent
    for name in _imports(source):
        place = Path(getattr(sys.modules.get(name), "__file__", None) or own / name).resolve()
        folder = place.parent.parent if place.name == "__init__.py" else place.parent
        if folder != own and str(folder) in _FOLDERS and ((own / f"{name}.py").exists() or (own / name).exists()):
            raise InvalidValueError(
                f"policy file {path} cannot be loaded: the module {name!r} that it imports is taken by {place}; "
                "give one of the two another name"
            )


def _imports(source: str) -> Iterator[str]:
    """Yield the outermost names of the modules that a text imports, anywhere in it; none if it is no Python."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name.partition(".")[0] for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def _is_beside(name: str, folder: Path) -> bool:
    """Return whether Python would take a module of this name from the folder, where nothing else has the name."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    places = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin or ""]
    return spec is None or any(Path(each).resolve().is_relative_to(folder) for each in places if each)


def describe(error: Exception) -> str:
    """Return the kind and text of an error of a user's code."""
    return f"{type(error).__name__}: {error}"


def _public_name(base: type) -> str:
    home = "coopsim" if hasattr(sys.modules.get("coopsim"), base.__name__) else base.__module__
    return f"{home}.{base.__name__}"


def _is_own(module: ModuleType, name: str, base: type) -> bool:
    found = getattr(module, name)
    return isinstance(found, type) and found.__module__ == module.__name__ and issubclass(found, base)
