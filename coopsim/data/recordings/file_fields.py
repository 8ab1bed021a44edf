"""Fields of YAML and JSON files: checked values, and errors that name file and field."""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.kitti import ID_LIMIT, REACH_M
from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3, Floats

_ORTHONORMAL = 1e-2  # calibrations are written with few digits


class Fields:
    """The fields of a mapping in a file.

    Args:
        content: the mapping, or what stands in its place.
        file: path of the file.
        name: of the mapping in the file; empty: it is all of it.

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
        return RecordingError(f"{self.file}: {self._named(key)} {problem}")

    def value(self, key: str) -> Any:
        """Return a field's value as it is; raise `RecordingError` if it is missing."""
        if key not in self._content:
            raise self.error(key, "is missing")
        return self._content[key]

    def section(self, key: str) -> Fields:
        """Return a field that is a mapping."""
        return Fields(self.value(key), self.file, self._named(key))

    def sections(self) -> Iterator[tuple[Any, Fields]]:
        """Yield the fields, all of which are mappings, with their keys."""
        for key, content in self._content.items():
            yield key, Fields(content, self.file, self._named(key))

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

    def _named(self, key: object) -> str:
        return f"{self.name}.{key}" if self.name else str(key)


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
