"""The conformance check of a codec."""

from __future__ import annotations

import contextlib
import random
import tracemalloc
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec
from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import CodecError

_FLIPS, _RANDOM = 1000, 200


def check_codec(codec: str | Codec[Any] | type[Codec[Any]], contents: Sequence[Any]) -> None:
    """Check that a codec keeps what the channel and receivers rely on.

    Its class must be registered and can be made without arguments. What it encodes, any object of the class decodes;
    encoding the decoded content again must be stable. Bytes from anywhere are decoded or refused by `CodecError`, and
    take no more memory than `limit_bytes`; truncated payloads, and such with something after them, are refused. What
    is decoded cannot be written to. If the codec can leave something out, no payload is over its budget, unless it is
    that of empty content.

    Args:
        codec: a registered name or spec, an object, or a class.
        contents: content to try it on: several sizes, one of them empty.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no codec of that name is registered, or the class is not.
    """
    made = _make(codec)
    name = CODECS.name_of(type(made))
    assert isinstance(made.content, str) and made.content, f"{name}: content must be a name, got {made.content!r}"
    limit = made.limit_bytes
    assert isinstance(limit, int) and limit > 0, f"{name}: limit_bytes must be a positive integer, got {limit!r}"
    assert len(contents) >= 2, "contents must be at least two, one of them empty"
    reader = type(made)()
    payloads = []
    for content in contents:
        payload = made.encode(content)
        assert type(payload) is bytes, f"{name}: encode must return bytes, got {type(payload).__name__}"
        assert payload == made.encode(content), f"{name} must encode the same content alike"
        payloads.append(payload)
        decoded = reader.decode(payload)
        again = made.encode(decoded)
        assert made.encode(reader.decode(again)) == again, f"{name} must be stable once content was encoded"
        writable = next(_writable(decoded), None)
        assert writable is None, f"{name}: decoded arrays must be read-only, {writable} is not"
    _check_refusals(name, made, payloads)
    _check_memory(name, made, payloads)
    if made.divisible:
        for content in contents:
            _check_budgets(name, made, content)


def _make(codec: str | Codec[Any] | type[Codec[Any]]) -> Codec[Any]:
    if isinstance(codec, str):
        name, parameters = parse_spec("codec", codec)
        return instantiate("codec", name, CODECS.get(name), parameters)
    made = codec() if isinstance(codec, type) else codec
    assert isinstance(made, Codec), f"a codec must be a coopsim Codec, got {made!r}"
    return made


def _check_refusals(name: str, codec: Codec[Any], payloads: Sequence[bytes]) -> None:
    rng = random.Random(0)
    longest, middle = max(payloads, key=len), sorted(payloads, key=len)[len(payloads) // 2]
    lengths = range(len(longest)) if len(longest) <= _FLIPS else sorted(rng.sample(range(len(longest)), _FLIPS))
    for length in lengths:
        assert not _decodes(name, codec, longest[:length]), f"{name} must refuse a payload cut off at {length} bytes"
    for more in (b"\0", b"\xff", longest, bytes(1_000_000)):
        assert not _decodes(name, codec, longest + more), f"{name} must refuse {len(more)} bytes after a payload"
    bits = range(8 * len(middle))
    for position in rng.sample(bits, min(len(bits), _FLIPS)):
        broken = bytearray(middle)
        broken[position // 8] ^= 1 << position % 8
        _decodes(name, codec, bytes(broken))
    for _ in range(_RANDOM):
        kept = rng.randrange(min(40, len(longest)) + 1)
        _decodes(name, codec, longest[:kept] + rng.randbytes(rng.randrange(300)))


def _decodes(name: str, codec: Codec[Any], payload: bytes) -> bool:
    """Return whether bytes are decoded; the decoded content must be encodable."""
    try:
        content = codec.decode(payload)
    except CodecError:
        return False
    except Exception as error:
        raise AssertionError(
            f"{name} must refuse bytes by CodecError, got {type(error).__name__} for {payload[:60]!r}: {error}"
        ) from error
    try:
        codec.encode(content)
    except Exception as error:
        raise AssertionError(f"{name} must encode what it decodes of {payload[:60]!r}, got {error!r}") from error
    return True


def _check_memory(name: str, codec: Codec[Any], payloads: Sequence[bytes]) -> None:
    longest = max(payloads, key=len)
    tracemalloc.start()
    try:
        for payload in (*payloads, *_announcing_much(longest)):
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            with contextlib.suppress(CodecError):
                codec.decode(payload)
            peak = tracemalloc.get_traced_memory()[1] - before
            assert peak <= codec.limit_bytes, (
                f"{name} declares limit_bytes {codec.limit_bytes}, and took {peak} bytes for {payload[:60]!r}"
            )
    finally:
        tracemalloc.stop()


def _announcing_much(payload: bytes) -> Iterator[bytes]:
    """Yield payloads whose heads announce as much as they can."""
    for at in range(min(len(payload), 40)):
        for width in (1, 2, 4):
            yield payload[:at] + b"\xff" * width + payload[at + width :]


def _check_budgets(name: str, codec: Codec[Any], content: Any) -> None:
    whole = codec.encode(content)
    assert codec.encode_within(content, len(whole)) == whole, f"{name} must leave nothing out where all fits"
    empty = len(codec.encode_within(content, 1))
    for budget_bytes in sorted({1, len(whole) // 4, len(whole) // 2, len(whole) - 1}):
        payload = codec.encode_within(content, budget_bytes)
        codec.decode(payload)
        assert len(payload) <= max(budget_bytes, empty), (
            f"{name} must keep within a budget of {budget_bytes} bytes, got {len(payload)}"
        )


def _writable(content: object, place: str = "content") -> Iterator[str]:
    if isinstance(content, np.ndarray):
        if content.flags.writeable:
            yield place
    elif is_dataclass(content):
        for field in fields(content):
            yield from _writable(getattr(content, field.name), f"{place}.{field.name}")
    elif isinstance(content, Mapping):
        for key, value in content.items():
            yield from _writable(value, f"{place}[{key!r}]")
    elif isinstance(content, (list, tuple)):
        for number, value in enumerate(content):
            yield from _writable(value, f"{place}[{number}]")
