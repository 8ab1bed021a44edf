"""Codecs of feature maps, dense and sparse, with values as float32, float16, or int8 with a scale per row.

Sparse maps are Where2comm's (Hu et al., "Where2comm: Communication-Efficient Collaborative Perception via Spatial
Confidence Maps", NeurIPS 2022): the cells of largest confidence are sent, as many as the bandwidth allows. A map
may carry a request, by which a receiver asks for cells (`FeatureMap.request`); the asked sender weighs its confidences
by it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import CODECS, Codec, unpack_head
from coopsim.errors import CodecError, InvalidValueError
from coopsim.support.checks import require_choice, require_count, require_probability
from coopsim.types import BevGrid, FeatureMap, Ints

FeatureNumber = Literal["float32", "float16", "int8"]

FEATURE_NUMBERS: tuple[str, ...] = get_args(FeatureNumber)

MOST_VALUES = 2**24
"""The most values of one payload: 64 MiB of float32, as 256 channels of 256 x 256 cells."""

Values = NDArray[np.float32]

T = TypeVar("T")


class FeatureCodec(Codec[T]):
    """Codec of features; the first byte of its payloads is the kind of number: "float32", "float16" or "int8"."""

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
    """Return finite rows (R, M) as bytes: for int8 first R scales as float32, then row by row."""
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
    """Return the rows of a block, which must have the length `features_size`; raise if a value is not finite."""
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


MOST_CELLS = 2**20
"""The most cells of a map: 400 m x 400 m in cells of 0.4 m."""

_STATED = struct.Struct("<B")
"""Whether confidences follow."""

HEAD = struct.Struct("<BIB3H5d")
"""Kind of number; the network's number; edge of the request's blocks, 0 for none; channels, rows, columns; the grid:
least and largest x, least and largest y, edge of a cell, exact, so that equal grids stay equal."""


@dataclass(frozen=True, slots=True)
class FeatureHead:
    """Head of a feature map's payload.

    Attributes:
        number: kind of number.
        shape: channels, rows, columns.
        grid: the place of the cells.
        space: the network's number.
        request: see `FeatureMap`.
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
