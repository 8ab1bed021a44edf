"""Dense feature maps, as intermediate fusion sends them."""

from __future__ import annotations

import math
import struct

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

_HEAD = struct.Struct("<BB3H")
"""Kind of number, whether confidences follow, channels, rows, columns."""

GRID = struct.Struct("<5d")
"""Least and largest x, least and largest y, edge of a cell: exact, so that equal grids stay equal."""


def require_sendable_features(features: FeatureMap) -> None:
    """Raise `CodecError` unless the shape fits into a message and confidences are in [0, 1]."""
    if max(features.values.shape) > 0xFFFF:
        raise CodecError(f"channels, rows and columns are at most 65535, got {features.values.shape}")
    require_shape(features.values.shape)
    if features.confidence is not None and not ((features.confidence >= 0) & (features.confidence <= 1)).all():
        raise CodecError("confidences of features must be in [0, 1]")


def require_shape(shape: tuple[int, int, int]) -> None:
    """Raise `CodecError` if there are too many channels, rows and columns for one message."""
    if math.prod(shape) > MOST_VALUES or math.prod(shape[1:]) > MOST_CELLS:
        raise CodecError(f"no message has features {shape}: at most {MOST_VALUES} values of {MOST_CELLS} cells")


@CODECS.register("features")
class FeaturesCodec(FeatureCodec[FeatureMap]):
    """8 bytes of head (number, confidences or not, C, H and W as uint16), 40 of the grid, values channel by channel.

    | number | bytes a value | error |
    |---|---|---|
    | 0 "float32" | 4 | none |
    | 1 "float16" | 2 | 2^-11 of itself |
    | 2 "int8" | 1, and 4 a channel | 1/253 of the channel's largest |

    Confidences, where there are any, follow in one byte a cell. Decoded are at most 16,777,216 values, of 1,048,576
    cells.

    Args:
        number: "float32", "float16" or "int8".
    """

    content = "features"
    limit_bytes = 160 * 2**20

    def encode(self, content: FeatureMap) -> bytes:
        require_sendable_features(content)
        channels, height, width = content.values.shape
        stated = content.confidence is not None
        head = _HEAD.pack(self._first_byte, stated, channels, height, width) + pack_grid(content.grid)
        block = pack_features(content.values.reshape(channels, height * width), self._number)
        return head + block + (b"" if content.confidence is None else pack_confidence(content.confidence))

    def decode(self, payload: bytes) -> FeatureMap:
        first_byte, stated, *shape = unpack_head(payload, _HEAD, "features")
        channels, height, width = shape
        require_shape((channels, height, width))
        kind, rows, start = feature_number(first_byte), (channels, height * width), _HEAD.size + GRID.size
        end = start + features_size(rows, kind)
        if stated > 1 or len(payload) != end + stated * height * width:
            raise CodecError(f"{len(payload)} bytes are not {kind} features {tuple(shape)}")
        grid = unpack_grid(payload[_HEAD.size : start], (height, width))
        values = unpack_features(payload[start:end], rows, kind).reshape(shape)
        return FeatureMap(values, grid, unpack_confidence(payload[end:]).reshape(height, width) if stated else None)


def pack_grid(grid: BevGrid) -> bytes:
    """Return the grid's numbers as bytes."""
    return GRID.pack(*grid.x_m, *grid.y_m, grid.cell_m)


def unpack_grid(block: bytes, shape: tuple[int, int]) -> BevGrid:
    """Return the grid of a block of bytes; raises `CodecError` if it is no grid, or has another shape."""
    x_low, x_high, y_low, y_high, cell_m = GRID.unpack(block)
    try:
        grid = BevGrid((x_low, x_high), (y_low, y_high), cell_m)
    except InvalidValueError as error:
        raise CodecError(f"the grid of features is invalid: {error}") from error
    if grid.shape != shape:
        raise CodecError(f"the grid of features has {grid.shape} cells, announced were {shape}")
    return grid


def pack_confidence(confidence: NDArray[np.float32]) -> bytes:
    """Return confidences as one byte a cell."""
    return np.rint(confidence * 255).astype(np.uint8).tobytes()


def unpack_confidence(block: bytes) -> NDArray[np.float32]:
    """Return the confidences of a block of bytes, in one row."""
    return (np.frombuffer(block, np.uint8) / 255).astype(np.float32)
