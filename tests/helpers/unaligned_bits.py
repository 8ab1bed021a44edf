"""Bits of messages worked out by hand."""

from __future__ import annotations


def bits(*fields: tuple[int, int]) -> bytes:
    """Values and their widths in bits as bytes, the last filled with zeros."""
    text = "".join(f"{value:0{width}b}" for value, width in fields)
    return int(text.ljust(-(-len(text) // 8) * 8, "0"), 2).to_bytes(-(-len(text) // 8), "big")
