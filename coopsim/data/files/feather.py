"""Columns of Feather files, as Argoverse 2 has its tables and sweeps in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import RecordingError


def read_feather(path: Path, numbers: Sequence[str], texts: Sequence[str] = ()) -> Mapping[str, NDArray[Any]]:
    """Return columns (N,) by name, numbers in the file's own types.

    Raises:
        RecordingError: the file is missing, cut or no Feather file, lacks a column, or has something else in it than
            finite numbers or texts; names file and column.
    """
    import pyarrow as pa
    from pyarrow import feather

    try:
        table = feather.read_table(path, memory_map=False)
    except OSError as error:  # pyarrow's messages span lines and repeat the path
        if not path.is_file():
            raise RecordingError(f"no file {path}") from error
        raise RecordingError(f"{path} is no Feather file, or is cut off") from error
    except pa.ArrowException as error:
        raise RecordingError(f"{path} is no Feather file, or is cut off") from error
    for name in (*numbers, *texts):
        if name not in table.column_names:
            there = ", ".join(table.column_names)
            raise RecordingError(f"{path}: column {name} is missing; there are: {there}")
    columns = {name: table[name].to_numpy() for name in (*numbers, *texts)}
    for name in numbers:
        if columns[name].dtype.kind not in "iuf" or not np.isfinite(columns[name]).all():
            raise RecordingError(f"{path}: column {name} must have finite numbers, all of them")
    for name in texts:
        if not all(isinstance(value, str) for value in columns[name]):
            raise RecordingError(f"{path}: column {name} must have texts, all of them")
    return columns
