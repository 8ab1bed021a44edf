"""Arrays that stand end to end, apart again."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def split_rows(array: NDArray[Any], last: NDArray[np.int64]) -> list[NDArray[Any]]:
    """Split an array after the rows of these numbers, all of it.

    Raises:
        ValueError: it has more rows or fewer, or the numbers do not rise.
    """
    if len(array) != (last[-1] if len(last) else 0) or (np.diff(last, prepend=0) < 0).any():
        raise ValueError("its arrays have different lengths")
    return np.split(array, last[:-1]) if len(last) else []
