"""Sparse feature maps: only the cells in which the sender believes something is.

After Where2comm (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial Confidence Maps",
NeurIPS 2022): of a feature map, those cells are sent whose spatial confidence is largest, as many as the bandwidth has
room for. What receivers ask for (its request maps) is not part of the codec.
"""

from __future__ import annotations

import struct

import numpy as np

from coopsim.comms.codecs.codec import CODECS, unpack_head
from coopsim.comms.codecs.feature_codec import (
    pack_confidence,
    require_sendable_features,
    require_shape,
    unpack_confidence,
)
from coopsim.comms.codecs.feature_values import (
    FeatureCodec,
    FeatureNumber,
    feature_number,
    features_size,
    pack_features,
    unpack_features,
)
from coopsim.errors import CodecError
from coopsim.support.checks import require_count, require_probability
from coopsim.types import FeatureMap, Ints

_HEAD = struct.Struct("<B3HI")
"""Kind of number, channels, rows, columns, number of cells."""


@CODECS.register("sparse_features")
class SparseFeaturesCodec(FeatureCodec[FeatureMap]):
    """11 bytes of head (number, C, H and W as uint16, cells K as uint32), K cells as uint32 in order, their confidences
    in one byte each, then their values channel by channel as in `FeaturesCodec`.

    A cell's number is row x W + column. Cells that are not sent come back as zeros, with confidence 0. The error of
    what is sent is as in `FeaturesCodec`, by the channel's largest value among the cells that are. Decoded are at most
    16,777,216 values, of 1,048,576 cells, those that are not sent included.

    Args:
        most_cells: how many cells are sent at most.
        least_confidence: cells below are not sent, however few there are.
        number: how values are written.
    """

    content = "features"
    limit_bytes = 192 * 2**20

    def __init__(
        self, most_cells: int = 1000, least_confidence: float = 0.0, number: FeatureNumber = "float16"
    ) -> None:
        require_count(0, most_cells=most_cells)
        require_probability(least_confidence=least_confidence)
        super().__init__(number)
        self._most, self._least = most_cells, least_confidence

    def chosen(self, content: FeatureMap) -> Ints:
        """The numbers (K,) of the cells that are sent, in order; of equal confidences the first."""
        if content.confidence is None:
            raise CodecError("the surest cells can be sent only of features that have confidences")
        confidence = content.confidence.ravel()
        surest = np.argsort(-confidence, kind="stable")[: self._most]
        return np.sort(surest[confidence[surest] >= self._least])

    def encode(self, content: FeatureMap) -> bytes:
        require_sendable_features(content)
        cells = self.chosen(content)
        channels, height, width = content.values.shape
        assert content.confidence is not None
        head = _HEAD.pack(self._first_byte, channels, height, width, len(cells))
        values = content.values.reshape(channels, height * width)[:, cells]
        sure = pack_confidence(content.confidence.ravel()[cells])
        return head + cells.astype("<u4").tobytes() + sure + pack_features(values, self._number)

    def decode(self, payload: bytes) -> FeatureMap:
        first_byte, channels, height, width, count = unpack_head(payload, _HEAD, "features")
        require_shape((channels, height, width))
        kind = feature_number(first_byte)
        if len(payload) != _HEAD.size + 5 * count + features_size((channels, count), kind):
            raise CodecError(f"{len(payload)} bytes are not {count} cells of {channels} {kind} features")
        cells = np.frombuffer(payload, "<u4", count, _HEAD.size).astype(np.int64)
        if count and (cells[-1] >= height * width or (np.diff(cells) <= 0).any()):
            raise CodecError(f"cells must come in order, each once, and within {height} x {width}")
        start = _HEAD.size + 5 * count
        values = np.zeros((channels, height * width), dtype=np.float32)
        values[:, cells] = unpack_features(payload[start:], (channels, count), kind)
        confidence = np.zeros(height * width, dtype=np.float32)
        confidence[cells] = unpack_confidence(payload[start - count : start])
        return FeatureMap(values.reshape(channels, height, width), confidence.reshape(height, width))
