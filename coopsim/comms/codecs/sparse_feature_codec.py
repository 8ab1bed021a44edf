"""Sparse feature maps: only the cells in which the sender is most confident.

After Where2comm (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial Confidence Maps",
NeurIPS 2022): the cells of largest spatial confidence are sent, as many as the bandwidth allows. A map may carry a
request, by which a receiver asks for cells (`FeatureMap.request`); who is asked weighs its confidences by it.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from coopsim.comms.codecs.codec import CODECS, unpack_head
from coopsim.comms.codecs.feature_codec import (
    pack_confidence,
    pack_head,
    read_head,
    require_sendable_features,
    unpack_confidence,
)
from coopsim.comms.codecs.feature_values import (
    FeatureCodec,
    FeatureNumber,
    features_size,
    pack_features,
    unpack_features,
)
from coopsim.errors import CodecError
from coopsim.support.checks import require_count, require_probability
from coopsim.types import FeatureMap, Ints

_COUNT = struct.Struct("<I")
"""Number of cells."""

_SMALL_MAP = 2**16
"""Cells of a map that two bytes number."""


@CODECS.register("sparse_features")
class SparseFeaturesCodec(FeatureCodec[FeatureMap]):
    """52 bytes of head and grid as in `FeaturesCodec`, a request in one byte a block, K as uint32, the numbers of the K
    cells, their confidences in one byte each, then their values channel by channel as in `FeaturesCodec`.

    A cell's number is row x W + column. The numbers come in order, as uint16, as uint32 where the map has more than
    65,536 cells, or as one bit for each cell of the map where that is shorter. Cells that are not sent come back as
    zeros with confidence 0, and `FeatureMap.sent` tells them. Cells that the sender itself does not know are not sent.
    The error of what is sent is as in `FeaturesCodec`, by the channel's largest value among the cells that are. Decoded
    are at most 16,777,216 values, of 1,048,576 cells, those that are not sent included.

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
        """Return the numbers (K,) of the cells that are sent, in order; of equals the first."""
        return self._surest(content, self._most)

    def _surest(self, content: FeatureMap, most: int) -> Ints:
        if content.confidence is None:
            raise CodecError("the surest cells can be sent only of features that have confidences")
        allowed = content.confidence.ravel() >= self._least
        if content.sent is not None:
            allowed &= content.sent.ravel()
        cells = np.flatnonzero(allowed)
        first = content.confidence if content.priority is None else content.priority
        return np.sort(cells[np.argsort(-first.ravel()[cells], kind="stable")[:most]])

    def encode(self, content: FeatureMap) -> bytes:
        return self._encode(content, self._most)

    def encode_within(self, content: FeatureMap, budget_bytes: int) -> bytes:
        channels, cells = len(content.values), math.prod(content.grid.shape)
        left = budget_bytes - len(self._encode(content, 0))
        per_cell = 1 + features_size((channels, 1), self._number) - features_size((channels, 0), self._number)
        by_number, by_bit = left // (per_cell + _number_bytes(cells)), (left - _bitmap_bytes(cells)) // per_cell
        return self._encode(content, min(self._most, max(0, by_number, by_bit)))

    def _encode(self, content: FeatureMap, most: int) -> bytes:
        require_sendable_features(content)
        cells = self._surest(content, most)
        channels, height, width = content.values.shape
        assert content.confidence is not None
        head = pack_head(content, self._first_byte) + _COUNT.pack(len(cells))
        values = content.values.reshape(channels, height * width)[:, cells]
        sure = pack_confidence(content.confidence.ravel()[cells])
        return head + _pack_cells(cells, height * width) + sure + pack_features(values, self._number)

    def decode(self, payload: bytes) -> FeatureMap:
        head = read_head(payload)
        channels, height, width = head.shape
        (count,) = unpack_head(payload[head.size_bytes :], _COUNT, "cells of features")
        first, all_cells = head.size_bytes + _COUNT.size, height * width
        sure = first + _cells_bytes(count, all_cells)
        start = sure + count
        if count > all_cells or len(payload) != start + features_size((channels, count), head.number):
            raise CodecError(f"{len(payload)} bytes are not {count} cells of {channels} {head.number} features")
        cells = _unpack_cells(payload[first:sure], count, all_cells)
        values = np.zeros((channels, all_cells), dtype=np.float32)
        values[:, cells] = unpack_features(payload[start:], (channels, count), head.number)
        confidence, sent = np.zeros(all_cells, dtype=np.float32), np.zeros(all_cells, dtype=np.bool_)
        confidence[cells], sent[cells] = unpack_confidence(payload[sure:start]), True
        shape = head.grid.shape
        known = confidence.reshape(shape), sent.reshape(shape)
        return FeatureMap(values.reshape(head.shape), head.grid, *known, head.request, head.space)


def _number_bytes(all_cells: int) -> int:
    return 2 if all_cells <= _SMALL_MAP else 4


def _bitmap_bytes(all_cells: int) -> int:
    return (all_cells + 7) // 8


def _cells_bytes(count: int, all_cells: int) -> int:
    """Return the length of K numbers of cells as they are packed: one by one, or as bits of all cells."""
    return min(count * _number_bytes(all_cells), _bitmap_bytes(all_cells))


def _pack_cells(cells: Ints, all_cells: int) -> bytes:
    if _bitmap_bytes(all_cells) < len(cells) * _number_bytes(all_cells):
        return np.packbits(np.bincount(cells, minlength=all_cells).astype(np.bool_)).tobytes()
    return cells.astype(f"<u{_number_bytes(all_cells)}").tobytes()


def _unpack_cells(block: bytes, count: int, all_cells: int) -> Ints:
    """Return K numbers of cells, in order; raises `CodecError` unless each is there once, and within the map."""
    if _bitmap_bytes(all_cells) < count * _number_bytes(all_cells):
        bits = np.unpackbits(np.frombuffer(block, np.uint8))
        if bits[all_cells:].any() or np.count_nonzero(bits) != count:
            raise CodecError(f"the bits of {all_cells} cells are not those of {count}")
        return np.flatnonzero(bits)
    cells = np.frombuffer(block, f"<u{_number_bytes(all_cells)}").astype(np.int64)
    if count and (cells[-1] >= all_cells or (np.diff(cells) <= 0).any()):
        raise CodecError(f"cells must come in order, each once, and be less than {all_cells}")
    return cells
