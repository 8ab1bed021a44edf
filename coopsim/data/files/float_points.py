"""LiDAR points as plain rows of float32, as KITTI (4 columns) and nuScenes (5 columns) keep them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import RecordingError


def encode_float_points(points: NDArray[np.float32], *columns: NDArray[Any]) -> bytes:
    """Return points (N, 3) m and further columns (N,) as rows of little-endian float32."""
    return np.column_stack([points, *columns]).astype("<f4").tobytes()


def read_float_points(path: Path, columns: int) -> NDArray[np.float32]:
    """Read the rows (N, columns) of a file.

    Raises:
        RecordingError: the file is missing, ends within a row, or has a number that is not finite.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    if len(content) % (4 * columns):
        raise RecordingError(f"{path}: a row is {columns} float32, {4 * columns} bytes; got {len(content)} bytes")
    rows = np.frombuffer(content, "<f4").reshape(-1, columns)
    if not np.isfinite(rows).all():
        raise RecordingError(f"{path}: all numbers must be finite")
    return rows
