"""Arrays of known dtype and shape from any input, and look-ups and runs of integers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from coopsim.errors import InvalidValueError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

Shape = tuple[int | None, ...]

S = TypeVar("S")
T = TypeVar("T", bound=np.generic)


def frozen(value: ArrayLike, shape: Shape, dtype: DTypeLike, what: str) -> NDArray[Any]:
    """Return `value` as a read-only array of `dtype` and `shape`; None in `shape` accepts any length.

    The caller's own array stays writable: the result is a read-only view, or a copy if the dtype differs.
    """
    if type(value) is np.ndarray and value.dtype == dtype and _fits(value.shape, shape):  # as most are
        if not value.flags.writeable:
            return value
        array = value.view()
        array.flags.writeable = False
        return array
    array = as_numbers(value, dtype, what, whole_floats=True).view()
    if not _fits(array.shape, shape):
        wanted = str(tuple("N" if length is None else length for length in shape)).replace("'", "")
        raise InvalidValueError(f"{what} must have shape {wanted}, got {array.shape}")
    array.flags.writeable = False
    return array


def freeze(owner: object, **columns: tuple[Shape, DTypeLike]) -> None:
    """Make attributes of a new frozen dataclass read-only arrays of these shapes and types; None stays None."""
    for name, (shape, dtype) in columns.items():
        value = getattr(owner, name)
        if value is not None:
            object.__setattr__(owner, name, frozen(value, shape, dtype, name))


def unchecked(cls: type[S], **attributes: Any) -> S:
    """Make a frozen dataclass without its checks; arrays, which must be new or read-only, become read-only.

    Types of which a frame makes hundreds do the same by hand, in half of the time.
    """
    made, put = object.__new__(cls), object.__setattr__
    for name, value in attributes.items():
        if type(value) is np.ndarray:
            value.setflags(write=False)
        put(made, name, value)
    return made


def sealed(array: NDArray[T]) -> NDArray[T]:
    """Make an array read-only and return it. It must be new, or a view that nobody else writes to."""
    array.setflags(write=False)
    return array


def _fits(shape: tuple[int, ...], wanted: Shape) -> bool:
    if shape == wanted:
        return True
    if len(shape) != len(wanted):
        return False
    for length, want in zip(shape, wanted, strict=True):  # noqa: SIM110  (a generator would take twice as long)
        if want is not None and length != want:
            return False
    return True


def as_numbers(value: ArrayLike, dtype: DTypeLike, what: str, *, whole_floats: bool = False) -> NDArray[Any]:
    """Return `value` as an array of an integer or float `dtype`, copied only if its own dtype differs.

    The kind is checked before the cast: text, flags and complex numbers are no numbers, floats are no integers (but for
    `whole_floats` without a fraction), and integers that do not fit are not wrapped around. An empty value is of any
    kind.
    """
    wanted = np.dtype(dtype)
    kind, accepted = ("integers", "iu") if wanted.kind in "iu" else ("numbers", "iuf")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"{what} must be {kind} in rows of the same length: {error}") from error
    if array.dtype == wanted:
        return array
    # Finite first: rounding a signalling NaN warns.
    if whole_floats and array.dtype.kind == "f" and np.isfinite(array).all() and (array == np.rint(array)).all():
        accepted = "iuf"
    if array.size and array.dtype.kind not in accepted:
        raise InvalidValueError(f"{what} must be {kind}, got {_described(array)}")
    if array.size and wanted.kind in "iu" and not np.can_cast(array.dtype, wanted):
        limits = np.iinfo(wanted)
        for extreme in (array.min(), array.max()):
            if not limits.min <= int(extreme) <= limits.max:
                raise InvalidValueError(f"{what} must be in {limits.min}..{limits.max}, got {extreme}")
    with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
        return array.astype(wanted)


def _described(array: NDArray[Any]) -> str:
    """Return an array's type and, if it is short, its content."""
    content = repr(array.tolist())
    return f"{array.dtype} {content}" if len(content) <= 40 else str(array.dtype)


def require_finite(array: NDArray[Any], what: str) -> None:
    """Raise `InvalidValueError`, naming the first bad index, unless every element is finite."""
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InvalidValueError(f"{what} must be finite, got {array[index]} at index {index}")


def look_up(rising: NDArray[np.int64], wanted: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Look up `wanted` (N,) in an array that rises. Return insertion indices (N,) and whether each is there (N,)."""
    place = np.searchsorted(rising, wanted)
    there = place < len(rising)
    there[there] = rising[place[there]] == wanted[there]
    return place, there


def numbered(counts: Ints) -> tuple[Ints, Ints]:
    """Return the group (N,), and the place (N,) within it, of each member of groups of `counts` members."""
    group = np.repeat(np.arange(len(counts)), counts)
    return group, np.arange(len(group)) - np.repeat(np.cumsum(counts) - counts, counts)


def runs_of(numbers: Iterable[int]) -> list[list[int]]:
    """Return the runs of integers in which each is one more than the one before, in the order that is given."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return runs


_DTYPES = {"int": np.int64, "float": np.float64, "bool": np.bool_}


def dtype_of(declaration: type[Any]) -> np.dtype[Any]:
    """Return the dtype with the fields of a class whose annotations are int, float or bool.

    Its module must postpone annotations (`from __future__ import annotations`), so that they are names.
    """
    return np.dtype([(name, _DTYPES[kind]) for name, kind in declaration.__annotations__.items()], align=True)
