"""Points one by one, as early fusion sends them."""

from __future__ import annotations

import struct
from typing import Literal, get_args

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec, unpack_head
from coopsim.errors import CodecError
from coopsim.support.checks import require_choice
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
    """One byte for the kind of number, four for the number of points, a float32 for the step; then row by row.

    | number | bytes a point | x, y, z | intensity |
    |---|---|---|---|
    | 0 "float32" | 16 | as they are | as it is |
    | 1 "float16" | 8 | 2^-11 of themselves (3 cm at 100 m) | 2^-12 |
    | 2 "int16" | 7 | in steps of 1/32,767 of the largest (1.5 mm at 100 m) | in steps of 1/255 |

    Decoded are at most 1,048,576 points.

    Args:
        number: "float32", "float16" or "int16".
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
