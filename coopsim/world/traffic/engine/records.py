"""Rows of structured arrays, declared once: as a type for type checkers, and as a dtype for numpy."""

from __future__ import annotations

from typing import Any

import numpy as np

_DTYPES = {"int": np.int64, "float": np.float64, "bool": np.bool_}


def dtype_of(declaration: type[Any]) -> np.dtype[Any]:
    """Return the dtype with the fields of a class whose annotations are int, float or bool.

    Its module must postpone annotations (`from __future__ import annotations`), so that they are names.
    """
    return np.dtype([(name, _DTYPES[kind]) for name, kind in declaration.__annotations__.items()], align=True)
