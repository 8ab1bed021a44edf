"""Rows of features as float32, float16, or int8 with a scale per row: the common part of feature codecs."""

from __future__ import annotations

from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import Codec
from coopsim.errors import CodecError
from coopsim.support.checks import require_choice

FeatureNumber = Literal["float32", "float16", "int8"]

FEATURE_NUMBERS: tuple[str, ...] = get_args(FeatureNumber)

MOST_VALUES = 2**24
"""The most values of one payload: 64 MiB of float32, as 256 channels of 256 x 256 cells."""

Values = NDArray[np.float32]

T = TypeVar("T")


class FeatureCodec(Codec[T]):
    """A codec of features; the first byte of its payloads is the kind of number.

    Args:
        number: "float32", "float16" or "int8".
    """

    def __init__(self, number: FeatureNumber = "float16") -> None:
        require_choice("number", number, FEATURE_NUMBERS)
        self._number = number

    @property
    def _first_byte(self) -> int:
        return FEATURE_NUMBERS.index(self._number)


def feature_number(first_byte: int) -> str:
    """Return the kind of number for the first byte of a payload; raises `CodecError` if it is unknown."""
    if first_byte >= len(FEATURE_NUMBERS):
        raise CodecError(f"no features are written in number {first_byte}: accepted are 0..{len(FEATURE_NUMBERS) - 1}")
    return FEATURE_NUMBERS[first_byte]


def pack_features(values: Values, number: str) -> bytes:
    """Return rows (R, M) as bytes: for int8 first R scales as float32, then row by row.

    Raises:
        CodecError: a value is not finite, or is beyond float16.
    """
    if not np.isfinite(values).all():
        raise CodecError("features must be finite")
    if number == "float32":
        return values.astype("<f4").tobytes()
    if number == "float16":
        if np.abs(values).max(initial=0.0) > float(np.finfo(np.float16).max):
            raise CodecError("features beyond 65504 are too large for float16")
        return values.astype("<f2").tobytes()
    # Not below the least normal float32, by which one can divide.
    scale = np.maximum(np.abs(values).max(axis=1, keepdims=True, initial=0.0) / 127, np.float32(1.2e-38))
    steps = np.clip(np.rint(values / scale), -127, 127).astype(np.int8)
    packed: bytes = scale.astype("<f4").tobytes() + steps.tobytes()
    return packed


def features_size(shape: tuple[int, int], number: str) -> int:
    """Return the number of bytes of packed rows of a shape (R, M)."""
    rows, length = shape
    return {"float32": 4 * rows * length, "float16": 2 * rows * length, "int8": rows * (4 + length)}[number]


def unpack_features(block: bytes, shape: tuple[int, int], number: str) -> Values:
    """Return the rows of a block, which must have the length `features_size`.

    Raises:
        CodecError: a value is not finite.
    """
    if number == "int8":
        scale = np.frombuffer(block, "<f4", count=shape[0])[:, None]
        steps = np.frombuffer(block, np.int8, offset=4 * shape[0]).reshape(shape)
        if not (np.isfinite(scale).all() and (np.abs(scale) < np.finfo(np.float32).max / 128).all()):
            raise CodecError("scales of features must be finite")
        stepped: Values = (steps * scale).astype(np.float32, copy=False)
        return stepped
    written = np.frombuffer(block, "<f4" if number == "float32" else "<f2").reshape(shape)
    with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one, and is refused
        values = written.astype(np.float32)
    if not np.isfinite(values).all():
        raise CodecError("features must be finite")
    return values
