"""Fields of YAML and JSON files: checked values, and errors that name file and field.

YAML is read from its literal data: nothing is imported by name, called or unpickled. Some data sets were written with
`yaml.dump` of dictionaries with arrays, whose tags name functions of NumPy; arrays, scalars and tuples of plain numbers
are rebuilt here, and all other tags of Python are refused.
"""

from __future__ import annotations

import json
import math
import re
import reprlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from yaml.constructor import ConstructorError

from coopsim.config.yaml_file import load_bounded
from coopsim.data.kitti import ID_LIMIT, REACH_M
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.se3 import SE3, Floats

_ORTHONORMAL = 1e-2  # calibrations are written with few digits


class Fields:
    """The fields of a mapping in a file.

    Args:
        content: the mapping, or what stands in its place.
        file: path of the file.
        name: name of the mapping in the file; empty: it is all of it.

    Raises:
        RecordingError: the content is no mapping.
    """

    def __init__(self, content: object, file: Path, name: str = "") -> None:
        self.file, self.name = file, name
        if not isinstance(content, Mapping):
            raise RecordingError(f"{file}: {name or 'the file'} must have keys and values, got {_shown(content)}")
        self._content: Mapping[Any, Any] = content

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def error(self, key: object, problem: str) -> RecordingError:
        """Return an error about a field."""
        return RecordingError(f"{self.file}: {self.field(key)} {problem}")

    def value(self, key: str) -> Any:
        """Return a field's value as it is; raise `RecordingError` if it is missing."""
        if key not in self._content:
            raise self.error(key, "is missing")
        return self._content[key]

    def section(self, key: str) -> Fields:
        """Return a field that is a mapping."""
        return Fields(self.value(key), self.file, self.field(key))

    def sections(self) -> Iterator[tuple[Any, Fields]]:
        """Yield the fields, all of which are mappings, with their keys."""
        for key, content in self._content.items():
            yield key, Fields(content, self.file, self.field(key))

    def text(self, key: str) -> str:
        """Return a field that is a text or a number, as text."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise self.error(key, f"must be a text, got {_shown(value)}")
        return str(value)

    def number(self, key: str) -> float:
        """Return a field that is a finite number of at most `REACH_M`; a text of one is accepted."""
        return float(self.numbers(key, ())[()])

    def numbers(self, key: str, *shapes: tuple[int, ...]) -> Floats:
        """Return a field of finite numbers, lists of them or an array, in one of some shapes."""
        value = self.value(key)
        wanted = " or ".join("a number" if not shape else " x ".join(map(str, shape)) + " numbers" for shape in shapes)
        try:
            array = np.asarray(value, dtype=np.float64)  # texts of numbers, too
        except (TypeError, ValueError, OverflowError):
            raise self.error(key, f"must be {wanted}, got {_shown(value)}") from None
        if array.shape not in shapes or isinstance(value, bool):
            raise self.error(key, f"must be {wanted}, got {_shown(value)}")
        if not np.isfinite(array).all() or np.abs(array).max(initial=0.0) > REACH_M:
            raise self.error(key, f"must be finite and within {REACH_M:g}, got {_shown(value)}")
        return array

    def sizes(self, key: str, *shapes: tuple[int, ...]) -> Floats:
        """Return a field of numbers > 0, as `numbers` does."""
        array = self.numbers(key, *shapes)
        if array.min() <= 0:
            raise self.error(key, f"must be > 0, got {_shown(self.value(key))}")
        return array

    def transform(self, key: str) -> SE3:
        """Return a field that is a rigid transform, a matrix 4 x 4."""
        return self.as_transform(key, self.numbers(key, (4, 4)))

    def as_transform(self, key: str, matrix: Floats) -> SE3:
        """Return a matrix (4, 4) of a field as a rigid transform; its rotation is made exact."""
        rotation = matrix[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(rotation) < 0:
            raise self.error(key, f"must have a rotation in its left 3 x 3, got {_shown(rotation.tolist())}")
        left, _, right = np.linalg.svd(rotation)
        return SE3(left @ right, matrix[:3, 3])

    def placed(self) -> SE3:
        """Return the pose of the fields `translation` (3,) m and `rotation`, a quaternion w, x, y, z."""
        try:
            return pose_of_quaternion(self.numbers("rotation", (4,)), self.numbers("translation", (3,)))
        except InvalidValueError as error:
            raise self.error("rotation", str(error)) from error

    def field(self, key: object) -> str:
        """Return the name of a field in the file."""
        return f"{self.name}.{key}" if self.name else str(key)


def pose_of_quaternion(wxyz: Floats, translation_m: Floats) -> SE3:
    """Return the pose of a quaternion (4,) and a translation (3,); raises `InvalidValueError` unless its norm is 1."""
    norm = float(np.linalg.norm(wxyz))
    if abs(norm - 1.0) > _ORTHONORMAL:
        raise InvalidValueError(f"must be a quaternion w, x, y, z of norm 1, got {_shown(wxyz.tolist())}")
    w, x, y, z = wxyz / norm
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return SE3(np.array(rotation), translation_m)


def as_id(value: object, file: Path, name: str) -> int:
    """Return an id, an integer or a text of one.

    Raises:
        RecordingError: it is no number; names the file and the field.
    """
    text = str(value).strip() if isinstance(value, (int, str)) else ""
    digits = text.removeprefix("-")
    if isinstance(value, bool) or not (digits.isascii() and digits.isdecimal()) or abs(int(text)) >= ID_LIMIT:
        raise RecordingError(f"{file}: the id of {name} must be an integer, got {_shown(value)}")
    return int(text)


def read_json(path: Path) -> Any:
    """Read a JSON file. Raises `RecordingError`, with the line where it is broken."""
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=lambda _: math.nan)
    except json.JSONDecodeError as error:
        raise RecordingError(f"{path}, line {error.lineno}: this is no JSON: {error.msg}") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise RecordingError(f"{path} is no JSON: {error}") from error


def _shown(value: object) -> str:
    text = " ".join(_SHORT.repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}..."


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxdict, _SHORT.maxlist, _SHORT.maxtuple = 4, 8, 8, 8
_SHORT.maxstring = _SHORT.maxother = 100


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
