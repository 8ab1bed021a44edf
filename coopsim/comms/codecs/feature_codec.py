"""Dense feature maps: what intermediate fusion sends."""

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
from coopsim.errors import CodecError
from coopsim.types import FeatureMap

MOST_CELLS = 2**20
"""The most cells of a map: 400 m x 400 m in cells of 0.4 m."""

CONFIDENCE_ERROR = 0.5 / 255 + 1e-6
"""Confidences are sent in steps of 1/255."""

_HEAD = struct.Struct("<BB3H")
"""Kind of number, whether confidences follow, channels, rows, columns."""


def require_sendable_features(features: FeatureMap) -> None:
    """Raise `CodecError` unless a message can hold the map's shape, and confidences are in [0, 1]."""
    if max(features.values.shape) > 0xFFFF:
        raise CodecError(f"channels, rows and columns are at most 65535, got {features.values.shape}")
    require_shape(features.values.shape)
    if features.confidence is not None and not ((features.confidence >= 0) & (features.confidence <= 1)).all():
        raise CodecError("confidences of features must be in [0, 1]")


def require_shape(shape: tuple[int, int, int]) -> None:
    """Raise `CodecError` if channels, rows and columns are too many for one message."""
    if math.prod(shape) > MOST_VALUES or math.prod(shape[1:]) > MOST_CELLS:
        raise CodecError(f"no message has features {shape}: at most {MOST_VALUES} values of {MOST_CELLS} cells")


@CODECS.register("features")
class FeaturesCodec(FeatureCodec[FeatureMap]):
    """8 bytes of head (number, confidences or not, C, H and W as uint16), then values channel by channel.

    | number | bytes a value | error |
    |---|---|---|
    | 0 "float32" | 4 | none |
    | 1 "float16" | 2 | 2^-11 of itself |
    | 2 "int8" | 1, and 4 a channel | 1/253 of the channel's largest |

    Confidences, where there are any, follow in one byte a cell. Decoded are at most 16,777,216 values, of 1,048,576
    cells.

    Args:
        number: how values are written.
    """

    content = "features"
    limit_bytes = 160 * 2**20

    def encode(self, content: FeatureMap) -> bytes:
        require_sendable_features(content)
        channels, height, width = content.values.shape
        stated = content.confidence is not None
        head = _HEAD.pack(self._first_byte, stated, channels, height, width)
        block = pack_features(content.values.reshape(channels, height * width), self._number)
        return head + block + (b"" if content.confidence is None else pack_confidence(content.confidence))

    def decode(self, payload: bytes) -> FeatureMap:
        first_byte, stated, *shape = unpack_head(payload, _HEAD, "features")
        channels, height, width = shape
        require_shape((channels, height, width))
        kind, rows = feature_number(first_byte), (channels, height * width)
        end = _HEAD.size + features_size(rows, kind)
        if stated > 1 or len(payload) != end + stated * height * width:
            raise CodecError(f"{len(payload)} bytes are not {kind} features {tuple(shape)}")
        values = unpack_features(payload[_HEAD.size : end], rows, kind).reshape(shape)
        return FeatureMap(values, unpack_confidence(payload[end:]).reshape(height, width) if stated else None)


def pack_confidence(confidence: NDArray[np.float32]) -> bytes:
    """One byte a cell."""
    return np.rint(confidence * 255).astype(np.uint8).tobytes()


def unpack_confidence(block: bytes) -> NDArray[np.float32]:
    """What `pack_confidence` was given, in one row."""
    return (np.frombuffer(block, np.uint8) / 255).astype(np.float32)
