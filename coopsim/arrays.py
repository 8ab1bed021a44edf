"""The one place where input becomes an array of known dtype and shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from coopsim.errors import InvalidValueError

Shape = tuple[int | None, ...]


def frozen(value: ArrayLike, shape: Shape, dtype: DTypeLike, what: str) -> NDArray[Any]:
    """`value` as a read-only array of `dtype` and `shape`; None in `shape` accepts any length.

    The caller's own array stays writable: what is returned is a read-only view (or a copy, where the
    dtype differs).
    """
    try:
        array = np.asarray(value, dtype=dtype).view()
    except (TypeError, ValueError) as error:
        raise InvalidValueError(f"{what} must be numbers of type {np.dtype(dtype)}: {error}") from error
    if array.ndim != len(shape) or any(
        want is not None and got != want for got, want in zip(array.shape, shape, strict=True)
    ):
        wanted = tuple("N" if length is None else length for length in shape)
        raise InvalidValueError(f"{what} must have shape {wanted}, got {array.shape}".replace("'", ""))
    array.flags.writeable = False
    return array


def require_finite(array: NDArray[Any], what: str) -> None:
    """Raise `InvalidValueError`, naming the first bad index, unless every element is finite."""
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InvalidValueError(f"{what} must be finite, got {array[index]} at index {index}")
