"""Arrays of known dtype and shape from any input, and lookups of many ids at once."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from coopsim.errors import InvalidValueError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

Shape = tuple[int | None, ...]

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
    """Return `value` as an array of `dtype`, copied only if its own dtype differs.

    The kind is checked before the cast: text, flags and complex numbers are no numbers, floats are no integers, and
    integers that do not fit are not wrapped around. An empty value is of any kind.

    Args:
        value: the input.
        dtype: an integer or float type.
        what: the value's name, for errors.
        whole_floats: accept floats without a fraction as integers.

    Raises:
        InvalidValueError: the value is no such array.
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
