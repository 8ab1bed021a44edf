"""Codecs of point clouds: points one by one, or the voxels that hold them in about two bytes each."""

from __future__ import annotations

import math
import struct
import zlib
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import CODECS, Codec, inflate, unpack_head
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_choice
from coopsim.types import PointCloud

MOST_POINTS = 2**20
"""The most points in one message: five turns of a sensor with 64 beams."""

PointNumber = Literal["float32", "float16", "int16"]

_NUMBERS: tuple[str, ...] = get_args(PointNumber)
_ROWS = {
    "float32": np.dtype([("xyz", "<f4", (3,)), ("intensity", "<f4")]),
    "float16": np.dtype([("xyz", "<f2", (3,)), ("intensity", "<f2")]),
    "int16": np.dtype([("xyz", "<i2", (3,)), ("intensity", "u1")]),
}
_HEAD = struct.Struct("<BIf")


def require_sendable_points(cloud: PointCloud) -> None:
    """Raise `CodecError` for too many points, and unless all are finite and intensities in [0, 1]."""
    if len(cloud) > MOST_POINTS:
        raise CodecError(f"one message carries at most {MOST_POINTS} points, got {len(cloud)}")
    if not np.isfinite(cloud.xyz).all():
        raise CodecError("points must be finite")
    if not ((cloud.intensity >= 0) & (cloud.intensity <= 1)).all():
        raise CodecError("intensities of points must be in [0, 1]")


@CODECS.register("points")
class PointsCodec(Codec[PointCloud]):
    """Points row by row, after a byte for the kind of number, four for the number of points, and a float32 for the
    step.

    | number | bytes a point | x, y, z | intensity |
    |---|---|---|---|
    | 0 "float32" | 16 | as they are | as it is |
    | 1 "float16" | 8 | 2^-11 of themselves (3 cm at 100 m) | 2^-12 |
    | 2 "int16" | 7 | in steps of 1/32,767 of the largest (1.5 mm at 100 m) | in steps of 1/255 |

    Decoded are at most 1,048,576 points.

    Args:
        number: "float32", "float16" or "int8".
    """

    content = "points"
    limit_bytes = 64 * 2**20

    def __init__(self, number: PointNumber = "int16") -> None:
        require_choice("number", number, _NUMBERS)
        self._number = number

    def error_m(self, extent_m: float) -> float:
        """Return the largest error of a decoded coordinate, in a cloud whose largest coordinate is `extent_m`."""
        least = {"float32": 0.0, "float16": 2.0**-25, "int16": 2.0**-126}  # numbers, or the step, run out of bits there
        share = {"float32": 0.0, "float16": 2.0**-11, "int16": 1 / 65_000}
        return max(extent_m * share[self._number], least[self._number])

    def encode(self, content: PointCloud) -> bytes:
        require_sendable_points(content)
        rows, step = np.empty(len(content), dtype=_ROWS[self._number]), 1.0
        if self._number == "int16":
            # Not below the least normal float32, by which one can divide.
            step = float(np.float32(max(content.extent_m / 0x7FFF, 1.2e-38)))
            rows["xyz"] = np.clip(np.rint(content.xyz.astype(np.float64) / step), -0x7FFF, 0x7FFF)
            rows["intensity"] = np.rint(content.intensity * 255)
        elif self._number == "float16" and content.extent_m > float(np.finfo(np.float16).max):
            raise CodecError(f"float16 ends at 65504 m, got {content.extent_m:g} m")
        else:
            rows["xyz"], rows["intensity"] = content.xyz, content.intensity
        return _HEAD.pack(_NUMBERS.index(self._number), len(rows), step) + rows.tobytes()

    def encode_within(self, content: PointCloud, budget_bytes: int) -> bytes:
        """Return the payload of as many points as a budget holds, evenly spaced in their order.

        Sweeps are ordered by firing, so the points that are left out are evenly spread over the view.
        """
        count = max(0, budget_bytes - _HEAD.size) // _ROWS[self._number].itemsize
        if count < len(content):
            content = content[np.arange(count) * len(content) // max(count, 1)]
        return self.encode(content)

    def decode(self, payload: bytes) -> PointCloud:
        number, count, step = unpack_head(payload, _HEAD, "points")
        if number >= len(_NUMBERS) or count > MOST_POINTS or not 0 < step < 1e30:
            raise CodecError(f"no points have {count} rows of number {number} in steps of {step:g} m")
        row = _ROWS[_NUMBERS[number]]
        if len(payload) != _HEAD.size + count * row.itemsize:
            raise CodecError(f"{len(payload)} bytes are not {count} points of {row.itemsize} bytes each")
        rows = np.frombuffer(payload, dtype=row, offset=_HEAD.size)
        by_step = _NUMBERS[number] == "int16"
        xyz, intensity = rows["xyz"] * (step if by_step else 1), rows["intensity"] / (255 if by_step else 1)
        with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one, and is refused
            cloud = PointCloud(xyz.astype(np.float32), intensity.astype(np.float32))
        require_sendable_points(cloud)
        return cloud


_VOXEL_M = (1e-3, 100.0)
_MOST_CELLS = 2**32
_FARTHEST = 2**22
"""The largest index: beyond, float32 cannot tell the centres of two voxels apart."""

_PLANES = 5
_EFFORT = 4

_VOXEL_HEAD = struct.Struct("<d3i3II")
"""Edge of a voxel (m), least index along x, y, z, number of indices along x, y, z, number of voxels."""


@CODECS.register("voxels")
class VoxelsCodec(Codec[PointCloud]):
    """The occupied voxels, sorted; decoded to their centres.

    36 bytes of head: edge (float64), three least indices (int32), three numbers of indices and the number of voxels
    (uint32). Then a zlib stream: the distance from each voxel's number to the next one's (uint32) and the mean
    intensity in steps of 1/255 (uint8), byte plane by byte plane (all lowest bytes first), because similar bytes in a
    row deflate best. A voxel's number counts along z first, then y, then x.

    Decoded are at most 1,048,576 voxels, in a box of less than 2^32.

    Args:
        voxel_m: edge of a voxel, in [0.001, 100] m.
    """

    content = "points"
    limit_bytes = 96 * 2**20
    INTENSITY_ERROR = 0.5 / 255 + 0.5 / 65_535 + 1e-7
    """Of a voxel's mean."""

    def __init__(self, voxel_m: float = 0.2) -> None:
        require_between(*_VOXEL_M, voxel_m=voxel_m)
        self._voxel_m = float(voxel_m)

    def error_m(self, extent_m: float) -> float:
        """Return the largest distance along x, y or z between a point and the centre of its voxel: half an edge.

        And the rounding of the centre to float32, in a cloud whose largest coordinate is `extent_m`.
        """
        return self._voxel_m / 2 + 2.0**-24 * (extent_m + self._voxel_m)

    def encode(self, content: PointCloud) -> bytes:
        return _encode(content, self._voxel_m)

    def encode_within(self, content: PointCloud, budget_bytes: int) -> bytes:
        """Return the payload with the smallest voxels that a budget holds.

        Resolution is left out, not parts of the view. Edges grow in steps of a quarter octave, up to 100 m. If not even
        those fit, no points are sent.
        """
        payload = self.encode(content)
        if len(payload) <= budget_bytes:
            return payload
        fits = _encode(PointCloud.empty(), self._voxel_m)
        least, most = 1, math.floor(4 * math.log2(_VOXEL_M[1] / self._voxel_m))
        while least <= most:
            step = (least + most) // 2
            payload = _encode(content, self._voxel_m * 2 ** (step / 4))
            if len(payload) <= budget_bytes:
                fits, most = payload, step - 1
            else:
                least = step + 1
        return fits

    def decode(self, payload: bytes) -> PointCloud:
        voxel_m, *corner, count = unpack_head(payload, _VOXEL_HEAD, "voxels")
        low, shape = corner[:3], corner[3:]
        near = all(first > -_FARTHEST and first + length <= _FARTHEST for first, length in zip(low, shape, strict=True))
        fits = count <= MOST_POINTS and math.prod(shape) < _MOST_CELLS
        if not (_VOXEL_M[0] <= voxel_m <= _VOXEL_M[1] and near and fits):
            raise CodecError(f"no message has {count} voxels of {voxel_m:g} m in a box of {shape} from {low}")
        if not count:
            if len(payload) > _VOXEL_HEAD.size or any(corner):
                raise CodecError("something follows where no voxels are announced")
            return PointCloud.empty()
        planes = np.frombuffer(inflate(payload[_VOXEL_HEAD.size :], _PLANES * count, "voxels"), np.uint8)
        number = _numbers(planes.reshape(_PLANES, count)[:4])
        if number[-1] >= math.prod(shape) or (np.diff(number) <= 0).any():
            raise CodecError("voxels must come in order, each once, and within their box")
        index = np.stack(np.unravel_index(number, shape), axis=1) + np.array(low, dtype=np.float64)
        xyz: NDArray[np.float32] = ((index + 0.5) * voxel_m).astype(np.float32)
        return PointCloud(xyz, (planes[-count:] / 255).astype(np.float32))


def _encode(content: PointCloud, voxel_m: float) -> bytes:
    require_sendable_points(content)
    if not len(content):
        return _VOXEL_HEAD.pack(voxel_m, 0, 0, 0, 0, 0, 0, 0)
    # Axis by axis in rows: numpy takes the least of many columns of three forty times slower.
    index = np.floor(np.ascontiguousarray(content.xyz.T, dtype=np.float64) / voxel_m)
    if np.abs(index).max() >= _FARTHEST:
        raise CodecError(f"a point is {content.extent_m:g} m away, too far for voxels of {voxel_m:g} m")
    low = index.min(axis=1, keepdims=True)
    x, y, z = cells = (index - low).astype(np.uint64)
    shape = [int(length) + 1 for length in cells.max(axis=1)]
    if math.prod(shape) >= _MOST_CELLS:
        raise CodecError(f"{shape} voxels of {voxel_m:g} m are too many: accepted are less than 2^32")
    voxels, intensity = _by_voxel((x * shape[1] + y) * shape[2] + z, content.intensity)
    planes = np.empty((_PLANES, len(voxels)), dtype=np.uint8)
    planes[:4] = np.diff(voxels, prepend=np.uint64(0)).astype("<u4").view(np.uint8).reshape(-1, 4).T
    planes[4] = np.rint(intensity * 255)
    head = _VOXEL_HEAD.pack(voxel_m, *low[:, 0].astype(np.int64).tolist(), *shape, len(voxels))
    return head + zlib.compress(planes.tobytes(), level=_EFFORT)


def _by_voxel(number: NDArray[np.uint64], intensity: NDArray[np.float32]) -> tuple[NDArray[np.uint64], Floats]:
    """Return the numbers of the occupied voxels, in order, and the mean intensity of their points.

    Intensities, in steps of 1/65,535, stand in the lowest bits of the sorted numbers, which saves a second look-up.
    """
    rows = number << np.uint64(16) | np.rint(intensity.astype(np.float64) * 0xFFFF).astype(np.uint64)
    rows.sort()
    sorted_number = rows >> np.uint64(16)
    first = np.flatnonzero(np.concatenate([[True], sorted_number[1:] != sorted_number[:-1]]))
    counts = np.diff(first, append=len(rows))
    means: Floats = np.add.reduceat((rows & np.uint64(0xFFFF)).astype(np.float64), first) / counts / 0xFFFF
    return sorted_number[first], means


def _numbers(planes: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the numbers of voxels, from the byte planes (4, N) of the distances between them."""
    distances = np.ascontiguousarray(planes.T).view("<u4")[:, 0]
    return np.cumsum(distances, dtype=np.int64)
