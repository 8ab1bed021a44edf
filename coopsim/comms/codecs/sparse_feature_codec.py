"""Sparse feature maps: only the cells in which the sender is most confident.

After Where2comm (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial Confidence Maps",
NeurIPS 2022): the cells of largest spatial confidence are sent, as many as the bandwidth allows. Its request maps, by
which receivers ask for cells, are not part of the codec.
"""

from __future__ import annotations

import struct

import numpy as np

from coopsim.comms.codecs.codec import CODECS, unpack_head
from coopsim.comms.codecs.feature_codec import (
    GRID,
    pack_confidence,
    pack_grid,
    require_sendable_features,
    require_shape,
    unpack_confidence,
    unpack_grid,
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
    """11 bytes of head (number, C, H and W as uint16, cells K as uint32), 40 of the grid, K cells as uint32 in order,
    their confidences in one byte each, then their values channel by channel as in `FeaturesCodec`.

    A cell's number is row x W + column. Cells that are not sent come back as zeros, with confidence 0. The error of
    what is sent is as in `FeaturesCodec`, by the channel's largest value among the cells that are. Decoded are at most
    16,777,216 values, of 1,048,576 cells, those that are not sent included.

    Args:
        most_cells: the most cells that are sent.
        least_confidence: the least confidence of a cell that is sent.
        number: "float32", "float16" or "int8".
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
        """Return the numbers (K,) of the cells that are sent, in order; of equal confidences the first."""
        return self._surest(content, self._most)

    def _surest(self, content: FeatureMap, most: int) -> Ints:
        if content.confidence is None:
            raise CodecError("the surest cells can be sent only of features that have confidences")
        confidence = content.confidence.ravel()
        surest = np.argsort(-confidence, kind="stable")[:most]
        return np.sort(surest[confidence[surest] >= self._least])

    def encode(self, content: FeatureMap) -> bytes:
        return self._encode(content, self._most)

    def encode_within(self, content: FeatureMap, budget_bytes: int) -> bytes:
        channels = len(content.values)
        fixed = len(self._encode(content, 0))
        per_cell = 5 + features_size((channels, 1), self._number) - features_size((channels, 0), self._number)
        return self._encode(content, min(self._most, max(0, budget_bytes - fixed) // per_cell))

    def _encode(self, content: FeatureMap, most: int) -> bytes:
        require_sendable_features(content)
        cells = self._surest(content, most)
        channels, height, width = content.values.shape
        assert content.confidence is not None
        head = _HEAD.pack(self._first_byte, channels, height, width, len(cells)) + pack_grid(content.grid)
        values = content.values.reshape(channels, height * width)[:, cells]
        sure = pack_confidence(content.confidence.ravel()[cells])
        return head + cells.astype("<u4").tobytes() + sure + pack_features(values, self._number)

    def decode(self, payload: bytes) -> FeatureMap:
        first_byte, channels, height, width, count = unpack_head(payload, _HEAD, "features")
        require_shape((channels, height, width))
        kind = feature_number(first_byte)
        start = _HEAD.size + GRID.size
        if len(payload) != start + 5 * count + features_size((channels, count), kind):
            raise CodecError(f"{len(payload)} bytes are not {count} cells of {channels} {kind} features")
        grid = unpack_grid(payload[_HEAD.size : start], (height, width))
        cells = np.frombuffer(payload, "<u4", count, start).astype(np.int64)
        if count and (cells[-1] >= height * width or (np.diff(cells) <= 0).any()):
            raise CodecError(f"cells must come in order, each once, and within {height} x {width}")
        start += 5 * count
        values = np.zeros((channels, height * width), dtype=np.float32)
        values[:, cells] = unpack_features(payload[start:], (channels, count), kind)
        confidence = np.zeros(height * width, dtype=np.float32)
        confidence[cells] = unpack_confidence(payload[start - count : start])
        return FeatureMap(values.reshape(channels, height, width), grid, confidence.reshape(height, width))
