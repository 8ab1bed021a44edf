"""LZF, the compression of PCD files (liblzf's format, from its description)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.support.kernels import njit

MOST_GROWTH = 88
"""Largest ratio of plain to compressed bytes: a back reference of three bytes stands for at most 264."""

_LONGEST_LITERAL, _LONG, _DAMAGED = 32, 7, -1


def inflate_lzf(compressed: bytes, size: int) -> NDArray[np.uint8]:
    """Return the `size` plain bytes of LZF data.

    Raises:
        InvalidValueError: the data are damaged, or hold another number of bytes. Nothing is allocated for a size that
            so few compressed bytes cannot hold.
    """
    if size > MOST_GROWTH * len(compressed):
        raise InvalidValueError(f"{len(compressed)} compressed bytes cannot hold {size}")
    plain = np.empty(size, np.uint8)
    filled = _inflate(np.frombuffer(compressed, np.uint8), plain)
    if filled != size:
        raise InvalidValueError(f"the compressed bytes are damaged, or do not hold {size} bytes")
    return plain


@njit(cache=True)
def _inflate(compressed: NDArray[np.uint8], plain: NDArray[np.uint8]) -> int:
    """Fill `plain`. Return the number of bytes that were there, or `_DAMAGED`.

    A first byte below 32 announces that many literal bytes and one more. In any other, the upper three bits are the
    length of a copy less two (7: the next byte is added), the lower five and the byte that follows are the distance
    back less one.
    """
    read, filled = 0, 0
    while read < len(compressed):
        control = int(compressed[read])
        read += 1
        if control < _LONGEST_LITERAL:
            length = control + 1
            if read + length > len(compressed) or filled + length > len(plain):
                return _DAMAGED
            plain[filled : filled + length] = compressed[read : read + length]
            read, filled = read + length, filled + length
            continue
        length = control >> 5
        if length == _LONG:
            if read >= len(compressed):
                return _DAMAGED
            length += int(compressed[read])
            read += 1
        if read >= len(compressed):
            return _DAMAGED
        source = filled - ((control & 31) << 8) - int(compressed[read]) - 1
        read += 1
        length += 2
        if source < 0 or filled + length > len(plain):
            return _DAMAGED
        for k in range(length):  # one by one: a copy may overlap what it copies
            plain[filled + k] = plain[source + k]
        filled += length
    return filled
