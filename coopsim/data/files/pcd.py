"""Point clouds in files: PCD with its compression LZF, and the plain float32 rows of KITTI and nuScenes.

Of PCD (version 0.7 of the Point Cloud Library's format) the three kinds of data are read (ascii, binary,
binary_compressed), with the fields x, y, z and an intensity: a field `intensity`, or the red of a field `rgb`, where
OPV2V keeps it. Other fields are passed over.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.support.arrays import frozen
from coopsim.support.kernels import njit

MOST_GROWTH = 88
"""Largest ratio of plain to compressed bytes: a back reference of three bytes stands for at most 264."""

_LONGEST_LITERAL, _LONG, _DAMAGED = 32, 7, -1


def inflate_lzf(compressed: bytes, size: int) -> NDArray[np.uint8]:
    """Return the `size` plain bytes of LZF data.

    Raises:
        InvalidValueError: the data are damaged, or hold another number of bytes. Nothing is allocated for a size that
            so few compressed bytes cannot hold.
    """
    if size > MOST_GROWTH * len(compressed):
        raise InvalidValueError(f"{len(compressed)} compressed bytes cannot hold {size}")
    plain = np.empty(size, np.uint8)
    filled = _inflate(np.frombuffer(compressed, np.uint8), plain)
    if filled != size:
        raise InvalidValueError(f"the compressed bytes are damaged, or do not hold {size} bytes")
    return plain


@njit(cache=True)
def _inflate(compressed: NDArray[np.uint8], plain: NDArray[np.uint8]) -> int:
    """Fill `plain`. Return the number of bytes that were there, or `_DAMAGED`.

    A first byte below 32 announces that many literal bytes and one more. In any other, the upper three bits are the
    length of a copy less two (7: the next byte is added), the lower five and the byte that follows are the distance
    back less one.
    """
    read, filled = 0, 0
    while read < len(compressed):
        control = int(compressed[read])
        read += 1
        if control < _LONGEST_LITERAL:
            length = control + 1
            if read + length > len(compressed) or filled + length > len(plain):
                return _DAMAGED
            plain[filled : filled + length] = compressed[read : read + length]
            read, filled = read + length, filled + length
            continue
        length = control >> 5
        if length == _LONG:
            if read >= len(compressed):
                return _DAMAGED
            length += int(compressed[read])
            read += 1
        if read >= len(compressed):
            return _DAMAGED
        source = filled - ((control & 31) << 8) - int(compressed[read]) - 1
        read += 1
        length += 2
        if source < 0 or filled + length > len(plain):
            return _DAMAGED
        for k in range(length):  # one by one: a copy may overlap what it copies
            plain[filled + k] = plain[source + k]
        filled += length
    return filled


_KEYS = ("FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "POINTS", "DATA")
_DATA = ("ascii", "binary", "binary_compressed")
_LONGEST_HEADER = 4096
_MOST_VALUES = 64
_DTYPES = {
    ("F", 4): "<f4", ("F", 8): "<f8",
    ("I", 1): "i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
    ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8",
}  # fmt: skip
_GREY = 0x010101  # times a byte: the same red, green and blue


@dataclass(frozen=True, slots=True, eq=False)
class PcdCloud:
    """The points of a PCD file.

    Attributes:
        points: (N, 3) m, float32, in the file's axes. Points that are not finite, as PCL marks missing ones, are left
            out.
        intensity: (N,) float32: the field `intensity` in the file's own unit, or the red of `rgb`, in [0, 1]; None:
            the file has neither.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        points = frozen(self.points, (None, 3), np.float32, "points")
        object.__setattr__(self, "points", points)
        if self.intensity is not None:
            intensity = frozen(self.intensity, (len(points),), np.float32, "intensity")
            object.__setattr__(self, "intensity", intensity)


def encode_rgb_pcd(points: NDArray[np.float32], intensity: NDArray[np.float32]) -> bytes:
    """Return a binary PCD file whose intensities are grey colours, as OPV2V has them.

    Args:
        points: (N, 3) m.
        intensity: (N,) in [0, 1], kept in steps of 1/255.
    """
    packed = np.rint(np.clip(intensity, 0.0, 1.0) * 255.0).astype(np.uint32) * _GREY
    return _encode(points, "rgb", packed)


def encode_intensity_pcd(points: NDArray[np.float32], intensity: NDArray[np.float32]) -> bytes:
    """Return a binary PCD file with a field `intensity`, as DAIR-V2X and V2X-Seq have it.

    Args:
        points: (N, 3) m.
        intensity: (N,) in the unit of the file.
    """
    return _encode(points, "intensity", intensity.astype(np.float32))


def _encode(points: NDArray[np.float32], name: str, values: NDArray[Any]) -> bytes:
    rows = np.empty(len(points), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, values.dtype)])
    for axis, letter in enumerate("xyz"):
        rows[letter] = points[:, axis]
    rows[name] = values  # a packed colour's bytes are announced as a float, as PCL does
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z {name}\nSIZE 4 4 4 4\nTYPE F F F F\n"
        f"COUNT 1 1 1 1\nWIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\nDATA binary\n"
    )
    return header.encode() + rows.tobytes()


def read_pcd(path: str | Path) -> PcdCloud:
    """Read a PCD file.

    Raises:
        RecordingError: the file is missing, or broken; the message names it and the header's line or the field.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    try:
        return _decode(content)
    except InvalidValueError as error:
        raise RecordingError(f"{path}: {error}") from error


def _decode(content: bytes) -> PcdCloud:
    header, body = _split(content)
    row = _row_type(header)
    count = _integer("POINTS", header["POINTS"])
    if _integer("WIDTH", header["WIDTH"]) * _integer("HEIGHT", header["HEIGHT"]) != count:
        raise InvalidValueError(f"WIDTH times HEIGHT must be POINTS = {count}")
    (kind,) = header["DATA"] if len(header["DATA"]) == 1 else ("",)
    if kind == "ascii":
        rows = _ascii_rows(body, row, count)
    elif kind == "binary":
        rows = _binary_rows(body, row, count)
    elif kind == "binary_compressed":
        rows = _compressed_rows(body, row, count)
    else:
        raise InvalidValueError(f"DATA must be one of {', '.join(_DATA)}, got {' '.join(header['DATA'])!r}")
    points = np.column_stack([rows[axis].astype(np.float32) for axis in "xyz"]).reshape(-1, 3)
    intensity = _intensity(rows)
    there = np.isfinite(points).all(axis=1)
    if intensity is not None and not np.isfinite(intensity[there]).all():
        raise InvalidValueError("field intensity must be finite")
    return PcdCloud(points[there], None if intensity is None else intensity[there])


def _split(content: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Split a file into its header, words by key, and its data."""
    end = re.search(rb"^DATA[^\n]*\n", content[:_LONGEST_HEADER], re.MULTILINE)
    if end is None:
        raise InvalidValueError(f"no PCD file: no line DATA in its first {_LONGEST_HEADER} bytes")
    header: dict[str, list[str]] = {}
    for line in content[: end.end()].decode("ascii", "replace").splitlines():
        key, *words = line.split() or ["#"]
        if not key.startswith("#"):
            header[{"COLUMNS": "FIELDS"}.get(key, key)] = words
    header.setdefault("COUNT", ["1"] * len(header.get("FIELDS", ())))
    for key in _KEYS:
        if key not in header:
            raise InvalidValueError(f"the header has no line {key}")
    return header, content[end.end() :]


def _row_type(header: dict[str, list[str]]) -> np.dtype[Any]:
    """Return the type of a row; repeated values and fields that are passed over keep their place."""
    names = header["FIELDS"]
    for key in ("SIZE", "TYPE", "COUNT"):
        if len(header[key]) != len(names):
            raise InvalidValueError(f"{key} must have an entry for each of {len(names)} fields, got {header[key]}")
    for axis in "xyz":
        if names.count(axis) != 1:
            raise InvalidValueError(f"FIELDS must have {axis} once, got {' '.join(names)}")
    columns: list[Any] = []
    for number, name in enumerate(names):
        size, count = _integer(f"SIZE of {name}", [header["SIZE"][number]]), header["COUNT"][number]
        kind = _DTYPES.get((header["TYPE"][number], size))
        if kind is None:
            raise InvalidValueError(f"TYPE and SIZE of {name} must be F, I or U of 1 to 8 bytes (F: 4 or 8)")
        repeated = _integer(f"COUNT of {name}", [count])
        if not 1 <= repeated <= _MOST_VALUES:
            raise InvalidValueError(f"COUNT of {name} must be in 1..{_MOST_VALUES}, got {repeated}")
        known = repeated == 1 and name in ("x", "y", "z", "rgb", "rgba", "intensity", "i") and names.count(name) == 1
        columns.append((name if known else f"passed over {number}", kind, (repeated,)) if not known else (name, kind))
    return np.dtype(columns)


def _ascii_rows(body: bytes, row: np.dtype[Any], count: int) -> NDArray[Any]:
    lines = body.decode("ascii", "replace").splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) != count:
        raise InvalidValueError(f"POINTS is {count}, but {len(lines)} lines follow")
    width = sum(int(np.prod(row[name].shape)) for name in row.names or ())
    try:
        values = np.array([line.split() for line in lines], np.float64).reshape(count, width)
    except ValueError as error:
        raise InvalidValueError(f"every point must be {width} numbers: {error}") from error
    rows, column = np.zeros(count, row), 0
    for name in row.names or ():
        wide = int(np.prod(row[name].shape))
        with np.errstate(invalid="ignore", over="ignore"):  # what is no number of the type is refused by its user
            rows[name] = values[:, column : column + wide].reshape(rows[name].shape)
        column += wide
    return rows


def _binary_rows(body: bytes, row: np.dtype[Any], count: int) -> NDArray[Any]:
    if len(body) < count * row.itemsize:
        raise InvalidValueError(
            f"POINTS is {count}, which take {count * row.itemsize} bytes, but {len(body)} follow: the file is cut off"
        )
    return np.frombuffer(body, row, count)


def _compressed_rows(body: bytes, row: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return rows of compressed data, in which each field's values stand together."""
    sizes = struct.Struct("<2I")
    if len(body) < sizes.size:
        raise InvalidValueError("the file is cut off after its header")
    compressed, plain = sizes.unpack_from(body)
    if plain != count * row.itemsize:
        raise InvalidValueError(
            f"POINTS is {count}, which take {count * row.itemsize} bytes, but {plain} are announced"
        )
    if len(body) - sizes.size < compressed:
        raise InvalidValueError(f"{compressed} compressed bytes are announced, but {len(body) - sizes.size} follow")
    values = inflate_lzf(body[sizes.size : sizes.size + compressed], plain)
    rows, at = np.empty(count, row), 0
    for name in row.names or ():
        size = row[name].itemsize * count
        rows[name] = values[at : at + size].view(row[name].base).reshape(rows[name].shape)
        at += size
    return rows


def _intensity(rows: NDArray[Any]) -> NDArray[np.float32] | None:
    names = rows.dtype.names or ()
    for name in ("intensity", "i"):
        if name in names:
            return rows[name].astype(np.float32)
    for name in ("rgb", "rgba"):
        if name in names:
            if rows.dtype[name].itemsize != 4:
                raise InvalidValueError(f"SIZE of {name} must be 4")
            packed = np.ascontiguousarray(rows[name]).view(np.uint32)
            red: NDArray[np.float32] = ((packed >> 16) & 0xFF).astype(np.float32) / np.float32(255.0)
            return red
    return None


def _integer(key: str, words: list[str]) -> int:
    if len(words) != 1 or not re.fullmatch(r"\d{1,12}", words[0]):
        raise InvalidValueError(f"{key} must be an integer >= 0, got {' '.join(words)!r}")
    return int(words[0])


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
