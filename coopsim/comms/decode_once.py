"""Decoding messages once, however many agents receive them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import numpy as np

from coopsim.errors import CodecError
from coopsim.types import Message

T = TypeVar("T")

_OVERHEAD_BYTES = 1000
"""Counted for each message besides its arrays."""


class DecodeOnce:
    """Memory of decoded messages: a broadcast is decoded for its first receiver, and looked up for the others.

    Delayed and duplicated messages are looked up, too, while they are remembered. All receivers get the same object:
    treat it as read-only, as arrays in coopsim's own types are. Beyond `most_bytes` of payloads and contents together,
    or `most_messages`, the least recently used are forgotten.
    """

    def __init__(self, most_bytes: int = 128 * 2**20, most_messages: int = 4096) -> None:
        self._most_bytes, self._bytes = most_bytes, 0
        self._most_messages = most_messages
        self._known: OrderedDict[Hashable, tuple[Any, str | None, int]] = OrderedDict()

    def __call__(self, message: Message, decode: Callable[[Message], T]) -> T:
        """Return the content of a message by `decode`, a pure function; a `CodecError` is remembered, too."""
        key = decode, message.identity
        known = self._known.get(key)
        if known is None:
            known = self._decode(key, message, decode)
        else:
            self._known.move_to_end(key)
        content, error, _ = known
        if error is not None:
            raise CodecError(error)
        decoded: T = content
        return decoded

    def _decode(self, key: Hashable, message: Message, decode: Callable[[Message], Any]) -> tuple[Any, str | None, int]:
        content, error = None, None
        try:
            content = decode(message)
        except CodecError as failure:
            error = str(failure)
        size = len(message.payload) + size_bytes(content) + _OVERHEAD_BYTES
        entry = self._known[key] = content, error, size
        self._bytes += size
        while self._bytes > self._most_bytes or len(self._known) > self._most_messages:
            _, (_, _, forgotten) = self._known.popitem(last=False)
            self._bytes -= forgotten
        return entry


def size_bytes(content: object) -> int:
    """Return the bytes of all arrays, texts and bytes in a content, through dataclasses, mappings and sequences."""
    if isinstance(content, (np.ndarray, np.generic)):
        return content.nbytes
    if isinstance(content, (bytes, str)):
        return len(content)
    if names := getattr(content, "__dataclass_fields__", None):  # `fields` takes several times as long
        return sum(size_bytes(getattr(content, name)) for name in names)
    if isinstance(content, Mapping):
        return sum(size_bytes(value) for value in content.values())
    if isinstance(content, (list, tuple)):
        return sum(map(size_bytes, content))
    return 0
