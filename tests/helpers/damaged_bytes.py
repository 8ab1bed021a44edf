"""Messages whose bytes were damaged on the way."""

from __future__ import annotations

from typing import Any

import pytest

from coopsim.errors import CodecError


def refusals(decode: Any, whole: bytes, every_bits: int) -> list[str]:
    """Check that no beginning of a message is read; return what is said of it with one bit flipped, where refused."""
    for end in range(len(whole)):
        with pytest.raises(CodecError):
            decode(whole[:end])
    refused = []
    for bit in range(0, 8 * len(whole), every_bits):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 0x80 >> bit % 8
        try:
            decode(bytes(flipped))
        except CodecError as error:
            refused.append(str(error))
    return refused
