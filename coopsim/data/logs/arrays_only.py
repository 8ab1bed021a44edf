"""Pickles of strangers: an unpickler that knows arrays, numbers, texts, lists and dictionaries, and runs nothing.

Every class or function that a pickle names is replaced by one of ours, or refused. Arrays are made here from their
bytes, of plain numbers only, so that not even numpy's own loader sees what a stranger wrote.
"""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import LogFileError

MOST_BYTES = 512 << 20

_KINDS = "biuf"
_NUMPY = ("numpy.core", "numpy._core")


class Word:
    """An enumeration's member, of which only the value is kept, such as `AgentType(1)`."""

    def __init__(self, *values: Any) -> None:
        self.value = values[0] if len(values) == 1 else None


class _Type:
    """A type of numbers."""

    def __init__(self, code: Any = None, *_: Any) -> None:
        self.code, self.order = code, "="

    def __setstate__(self, state: Any) -> None:
        if not (isinstance(state, tuple) and len(state) >= 2 and state[1] in ("<", ">", "|", "=")):
            raise pickle.UnpicklingError("a type of an array is broken")
        self.order = state[1]

    def dtype(self) -> np.dtype[Any]:
        """Return numpy's type.

        Raises:
            UnpicklingError: it is none of plain numbers.
        """
        code = self.code
        known = isinstance(code, str) and len(code) <= 3 and code[:1] in _KINDS and code[1:] in ("1", "2", "4", "8")
        if not known:
            raise pickle.UnpicklingError(f"an array must be of plain numbers, got the type {str(code)[:40]!r}")
        return np.dtype(f"{'' if self.order == '|' else self.order}{code}")


class _Array:
    """An array, whose numbers come after it."""

    def __init__(self, *_: Any) -> None:
        self.array: NDArray[Any] = np.zeros(0)

    def __setstate__(self, state: Any) -> None:
        if not (isinstance(state, tuple) and len(state) == 5 and isinstance(state[2], _Type)):
            raise pickle.UnpicklingError("an array is broken")
        _, shape, kind, columns_first, data = state
        if isinstance(data, str):  # as the second protocol has bytes
            data = data.encode("latin1")
        if not (isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape) and len(shape) <= 8):
            raise pickle.UnpicklingError("an array's shape is broken")
        self.array = np.frombuffer(data, kind.dtype()).reshape(shape, order="F" if columns_first else "C")


def _from_buffer(data: Any, kind: Any, shape: Any, order: Any) -> _Array:
    """Make an array as the fifth protocol has it."""
    found = _Array()
    found.__setstate__((1, shape, kind, order == "F", data))
    return found


def _scalar(kind: Any, data: Any) -> Any:
    if not isinstance(kind, _Type):
        raise pickle.UnpicklingError("a number is broken")
    return np.frombuffer(data, kind.dtype(), count=1)[0].item()


def _latin1(text: Any, _: Any) -> bytes:
    return str(text).encode("latin1")


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Return what stands for a class or function of a pickle."""
        if module == "numpy" and name in ("ndarray", "dtype"):
            return _Array if name == "ndarray" else _Type
        if module.startswith(_NUMPY) and name in ("_reconstruct", "scalar", "_frombuffer"):
            return {"_reconstruct": _Array, "scalar": _scalar, "_frombuffer": _from_buffer}[name]
        if (module, name) == ("_codecs", "encode"):
            return _latin1
        if name.endswith("Type"):
            return Word
        raise pickle.UnpicklingError(f"it names {module}.{name}, which is refused")

    def persistent_load(self, pid: Any) -> Any:
        """Refuse a reference to something outside."""
        raise pickle.UnpicklingError("it refers to something outside of it")


def read_arrays(path: Path) -> Any:
    """Return the content of a pickle: dictionaries, lists, tuples, texts, numbers, `Word` and arrays.

    Raises:
        LogFileError: the file is missing, too large, no pickle, or names anything else.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise LogFileError(f"{path} has more than the {MOST_BYTES >> 20} MB that are accepted of a pickle")
        return _plain(_Unpickler(io.BytesIO(path.read_bytes())).load(), {})
    except FileNotFoundError:
        raise LogFileError(f"no file {path}") from None
    except LogFileError:
        raise
    except RecursionError:
        raise LogFileError(f"{path}: the pickle is nested too deep") from None
    except Exception as error:  # a broken pickle raises whatever its broken part brings about
        said = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        accepted = "accepted: arrays, numbers, texts, lists and dictionaries"
        raise LogFileError(f"{path}: the pickle is broken, or has what is refused ({said}); {accepted}") from None


def _plain(value: Any, seen: dict[int, Any]) -> Any:
    """Return content with numpy's arrays in place of ours; parts may contain themselves, as MetaDrive's do."""
    if isinstance(value, _Array):
        return value.array
    if id(value) in seen:
        return seen[id(value)]
    if isinstance(value, dict):
        table = seen[id(value)] = {}
        table.update((key, _plain(each, seen)) for key, each in value.items())
        return table
    if isinstance(value, (list, tuple)):
        listed = seen[id(value)] = []
        listed.extend(_plain(each, seen) for each in value)
        return listed
    return value
