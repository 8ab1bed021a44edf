"""YAML with Python's and NumPy's tags, read from its literal data: nothing is imported by name, called or unpickled.

Some data sets were written with `yaml.dump` of dictionaries with arrays, whose tags name functions of NumPy. What these
stand for is rebuilt here: arrays, scalars and tuples of plain numbers. All other tags of Python are refused.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from yaml.constructor import ConstructorError

from coopsim.config.yaml_file import load_bounded
from coopsim.data.recordings.file_fields import Fields
from coopsim.errors import RecordingError

_PYTHON = "tag:yaml.org,2002:python/"
_NUMBERS = re.compile(r"[biuf][1248]")
_ORDERS = ("<", ">", "|", "=")
_MULTIARRAY = ("numpy.core.multiarray", "numpy._core.multiarray")


def read_tagged_yaml(path: Path) -> Fields:
    """Read a file whose root is a mapping.

    Raises:
        RecordingError: the file is missing, cut or no YAML, has another tag of Python, or is no mapping; names the file
            and, where known, the line.
    """
    try:
        content = load_bounded(_Loader(path.read_bytes()))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        problem = " ".join(str(error.problem).split())
        what = "" if isinstance(error, ConstructorError) else "this is no YAML: "
        raise RecordingError(f"{path}{line}: {what}{problem}") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(f"{path}: this is no YAML: {' '.join(str(error).split())}") from error
    return Fields(content, path)


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]  # yaml has no types
    """A safe loader that knows arrays, scalars and tuples of numbers."""


def _array(loader: Any, node: yaml.Node) -> Any:
    """Return the array of a call of NumPy's `_reconstruct` and its state: version, shape, dtype, order, bytes."""
    state = _part(loader, node, "state")
    match state:
        case (_, tuple(shape), np.dtype() as dtype, bool(columns_first), bytes(content)):
            try:
                array = np.frombuffer(content, dtype).reshape(shape, order="F" if columns_first else "C")
            except (TypeError, ValueError) as error:
                raise _refused(node, f"an array is broken: {error}") from None
            return array
    raise _refused(node, "an array must be of plain numbers")


def _scalar(loader: Any, node: yaml.Node) -> Any:
    match _arguments(loader, node):
        case [np.dtype() as dtype, bytes(content)] if len(content) == dtype.itemsize:
            return np.frombuffer(content, dtype)[0].item()
    raise _refused(node, "a scalar must be a plain number")


def _dtype(loader: Any, node: yaml.Node) -> Any:
    arguments = _arguments(loader, node)
    name = arguments[0] if arguments else None
    if not (isinstance(name, str) and _NUMBERS.fullmatch(name)):
        raise _refused(node, f"an array must be of plain numbers, got type {name!r}")
    order: Any = "="
    if isinstance(node, yaml.MappingNode):
        state = _part(loader, node, "state")
        order = state[1] if isinstance(state, tuple) and len(state) > 1 else None
    if order not in _ORDERS:
        raise _refused(node, f"the order of an array's bytes must be one of {', '.join(_ORDERS)}, got {order!r}")
    try:
        return np.dtype(name).newbyteorder(order)
    except TypeError as error:
        raise _refused(node, f"an array must be of plain numbers: {error}") from None


def _arguments(loader: Any, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return _part(loader, node, "args")


def _part(loader: Any, node: yaml.Node, name: str) -> Any:
    if not isinstance(node, yaml.MappingNode):
        raise _refused(node, f"{node.tag.removeprefix(_PYTHON)} has no {name}")
    content = loader.construct_mapping(node, deep=True)
    if name not in content:
        raise _refused(node, f"{node.tag.removeprefix(_PYTHON)} has no {name}")
    return content[name]


def _refused(node: yaml.Node, problem: str) -> ConstructorError:
    return ConstructorError(problem=problem, problem_mark=node.start_mark)


def _other(loader: Any, suffix: str, node: yaml.Node) -> Any:
    raise _refused(node, f"the tag python/{suffix} is refused: only arrays and plain numbers of NumPy are read")


def _add_tags() -> None:
    add = _Loader.add_constructor
    add(f"{_PYTHON}tuple", lambda loader, node: tuple(loader.construct_sequence(node, deep=True)))
    add(f"{_PYTHON}list", lambda loader, node: loader.construct_sequence(node, deep=True))
    add(f"{_PYTHON}dict", lambda loader, node: loader.construct_mapping(node, deep=True))
    for name, method in (
        ("int", "construct_yaml_int"),
        ("long", "construct_yaml_int"),
        ("float", "construct_yaml_float"),
        ("bool", "construct_yaml_bool"),
        ("none", "construct_yaml_null"),
        ("str", "construct_yaml_str"),
        ("unicode", "construct_yaml_str"),
    ):
        add(f"{_PYTHON}{name}", getattr(_Loader, method))
    add(f"{_PYTHON}name:numpy.ndarray", lambda loader, node: "numpy.ndarray")
    add(f"{_PYTHON}object/apply:numpy.dtype", _dtype)
    for module in _MULTIARRAY:
        add(f"{_PYTHON}object/apply:{module}._reconstruct", _array)
        add(f"{_PYTHON}object/apply:{module}.scalar", _scalar)
    _Loader.add_multi_constructor(_PYTHON, _other)


_add_tags()
