"""Dense feature maps, as intermediate fusion sends them."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import CODECS, unpack_head
from coopsim.comms.codecs.feature_values import (
    MOST_VALUES,
    FeatureCodec,
    feature_number,
    features_size,
    pack_features,
    unpack_features,
)
from coopsim.errors import CodecError, InvalidValueError
from coopsim.types import BevGrid, FeatureMap

MOST_CELLS = 2**20
"""The most cells of a map: 400 m x 400 m in cells of 0.4 m."""

CONFIDENCE_ERROR = 0.5 / 255 + 1e-6
"""Confidences are sent in steps of 1/255."""

_STATED = struct.Struct("<B")
"""Whether confidences follow."""

HEAD = struct.Struct("<BIB3H5d")
"""Kind of number; the network's number; edge of the request's blocks, 0 for none; channels, rows, columns; the grid:
least and largest x, least and largest y, edge of a cell, exact, so that equal grids stay equal."""


@dataclass(frozen=True, slots=True)
class FeatureHead:
    """What the payload of a feature map begins with.

    Attributes:
        number: kind of number.
        shape: channels, rows, columns.
        grid: the place of the cells.
        space: the network's number.
        request: as in `FeatureMap`.
        size_bytes: length of all this.
    """

    number: str
    shape: tuple[int, int, int]
    grid: BevGrid
    space: int
    request: NDArray[np.float32] | None
    size_bytes: int


def require_sendable_features(features: FeatureMap) -> None:
    """Raise `CodecError` unless the shape fits into a message, and confidences and requests are in [0, 1]."""
    if max(features.values.shape) > 0xFFFF:
        raise CodecError(f"channels, rows and columns are at most 65535, got {features.values.shape}")
    require_shape(features.values.shape)
    for what, share in (("confidences", features.confidence), ("requests", features.request)):
        if share is not None and not ((share >= 0) & (share <= 1)).all():
            raise CodecError(f"{what} of features must be in [0, 1]")


def require_shape(shape: tuple[int, int, int]) -> None:
    """Raise `CodecError` if there are too many channels, rows and columns for one message."""
    if math.prod(shape) > MOST_VALUES or math.prod(shape[1:]) > MOST_CELLS:
        raise CodecError(f"no message has features {shape}: at most {MOST_VALUES} values of {MOST_CELLS} cells")


@CODECS.register("features")
class FeaturesCodec(FeatureCodec[FeatureMap]):
    """53 bytes of head and grid, then values channel by channel.

    | number | bytes a value | error |
    |---|---|---|
    | 0 "float32" | 4 | none |
    | 1 "float16" | 2 | 2^-11 of itself |
    | 2 "int8" | 1, and 4 a channel | 1/253 of the channel's largest |

    Confidences, where there are any, follow in one byte a cell, and a request comes before the values in one byte a
    block. Cells that are not known are sent as what they are. Decoded are at most 16,777,216 values, of 1,048,576
    cells.

    Args:
        number: "float32", "float16" or "int8".
    """

    content = "features"
    limit_bytes = 160 * 2**20

    def encode(self, content: FeatureMap) -> bytes:
        require_sendable_features(content)
        channels, height, width = content.values.shape
        head = pack_head(content, self._first_byte) + _STATED.pack(content.confidence is not None)
        block = pack_features(content.values.reshape(channels, height * width), self._number)
        return head + block + (b"" if content.confidence is None else pack_confidence(content.confidence))

    def decode(self, payload: bytes) -> FeatureMap:
        head = read_head(payload)
        (stated,) = unpack_head(payload[head.size_bytes :], _STATED, "values of features")
        channels, height, width = head.shape
        start, rows = head.size_bytes + _STATED.size, (channels, height * width)
        end = start + features_size(rows, head.number)
        if stated > 1 or len(payload) != end + stated * height * width:
            raise CodecError(f"{len(payload)} bytes are not {head.number} features {head.shape}")
        values = unpack_features(payload[start:end], rows, head.number).reshape(head.shape)
        confidence = unpack_confidence(payload[end:]).reshape(height, width) if stated else None
        return FeatureMap(values, head.grid, confidence, request=head.request, space=head.space)


def pack_head(features: FeatureMap, first_byte: int) -> bytes:
    """Return the head of a payload: kind of number, space, shape, grid and request."""
    grid, request = features.grid, features.request
    numbers = (first_byte, features.space, features.request_block, *features.values.shape)
    head = HEAD.pack(*numbers, *grid.x_m, *grid.y_m, grid.cell_m)
    return head + (b"" if request is None else pack_confidence(request))


def read_head(payload: bytes) -> FeatureHead:
    """Return the head of a payload of features, dense or sparse; raises `CodecError` if it is none."""
    first_byte, space, block, channels, height, width, *numbers = unpack_head(payload, HEAD, "features")
    require_shape((channels, height, width))
    number, grid = feature_number(first_byte), _grid(numbers, (height, width))
    end, request = HEAD.size, None
    if block:
        if height % block or width % block:
            raise CodecError(f"blocks of {block} x {block} do not divide {height} x {width} cells")
        end += (height // block) * (width // block)
        if len(payload) < end:
            raise CodecError(f"{len(payload)} bytes are less than a head with a request of {end}")
        request = unpack_confidence(payload[HEAD.size : end]).reshape(height // block, width // block)
    return FeatureHead(number, (channels, height, width), grid, space, request, end)


def _grid(numbers: Sequence[float], shape: tuple[int, int]) -> BevGrid:
    x_low, x_high, y_low, y_high, cell_m = numbers
    try:
        grid = BevGrid((x_low, x_high), (y_low, y_high), cell_m)
    except InvalidValueError as error:
        raise CodecError(f"the grid of features is invalid: {error}") from error
    if grid.shape != shape:
        raise CodecError(f"the grid of features has {grid.shape} cells, announced were {shape}")
    return grid


def pack_confidence(confidence: NDArray[np.float32]) -> bytes:
    """Return confidences, or requests, as one byte each."""
    return np.rint(confidence * 255).astype(np.uint8).tobytes()


def unpack_confidence(block: bytes) -> NDArray[np.float32]:
    """Return the confidences of a block of bytes, in one row."""
    return (np.frombuffer(block, np.uint8) / 255).astype(np.float32)
