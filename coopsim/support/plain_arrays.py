"""Arrays in NumPy's files, .npy and .npz, of strangers: what a file announces is checked before memory is taken."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

from numpy.lib import format as npy
from numpy.typing import NDArray

_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_npy(path: Path, most_bytes: int) -> NDArray[Any]:
    """Return the array of a .npy file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has more than `most_bytes`, is no .npy file, has objects, or another size than it announces.
    """
    return _array(_content(path, most_bytes))


def read_npz(path: Path, most_bytes: int, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file by name, of those in `names` that are there; None: all.

    Raises:
        OSError: the file cannot be read.
        ValueError, zipfile.BadZipFile: the file, or its arrays together, have more than `most_bytes`, or an array is
            not as `read_npy` accepts it.
    """
    with zipfile.ZipFile(io.BytesIO(_content(path, most_bytes))) as archive:
        entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
        wanted = [name for name in entries if names is None or name in names]
        size = sum(entries[name].file_size for name in wanted)
        if size > most_bytes:
            raise ValueError(f"its arrays have {size} bytes, and {most_bytes} are accepted")
        return {name: _array(archive.read(entries[name])) for name in wanted}


def _content(path: Path, most_bytes: int) -> bytes:
    with path.open("rb") as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise ValueError(f"it has more than {most_bytes} bytes, which are accepted")
    return content


def _array(content: bytes) -> NDArray[Any]:
    file = io.BytesIO(content)
    version = npy.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"its format must be NumPy's 1.0 or 2.0, is {version[0]}.{version[1]}")
    shape, _, dtype = _HEADERS[version](file)
    announced, there = dtype.itemsize * math.prod(shape), len(content) - file.tell()
    if dtype.hasobject or announced != there or min(shape, default=0) < 0:
        what = "objects" if dtype.hasobject else f"{announced} bytes of the shape {shape}, and has {there}"
        raise ValueError(f"an array announces {what}")
    file.seek(0)
    array: NDArray[Any] = npy.read_array(file, allow_pickle=False)
    return array
