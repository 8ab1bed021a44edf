"""What every registered codec withstands: bytes from anywhere.

They are decoded or refused by `CodecError`, never worse, and never take more memory than the codec declares.
"""

from __future__ import annotations

import contextlib
import struct
import tracemalloc
import zlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from codec_samples import SAMPLES, some_detections, some_grid, some_queries
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.codecs.codec import CODECS, Codec, decoder
from coopsim.comms.codecs.feature_codec import FeaturesCodec, SparseFeaturesCodec
from coopsim.errors import CodecError, UnknownNameError
from coopsim.testing import check_codec
from coopsim.types import FeatureMap

EVERY = pytest.mark.parametrize("name", CODECS.names())


def payload(name: str, count: int = 5) -> bytes:
    return decoder(name).encode(SAMPLES[name](count))


def test_every_codec_has_a_sample() -> None:
    assert set(SAMPLES) == set(CODECS.names())


@EVERY
def test_codec(name: str) -> None:
    check_codec(name, [SAMPLES[name](count) for count in (0, 1, 3, 5)])


def test_codecs_with_parameters() -> None:
    check_codec("sparse_features(most_cells=5, number=int8)", [SAMPLES["features"](count) for count in (0, 2)])
    check_codec("voxels(voxel_m=2.0)", [SAMPLES["points"](count) for count in (0, 40)])


@EVERY
@settings(max_examples=60)
@given(noise=st.binary(max_size=300), kept=st.integers(0, 40))
def test_random_bytes_are_refused_or_decoded_never_worse(name: str, noise: bytes, kept: int) -> None:
    with contextlib.suppress(CodecError):
        content = decoder(name).decode(payload(name, 2)[:kept] + noise)  # past the head
        decoder(name).encode(content)


def bombs(name: str) -> Iterator[bytes]:
    """Small payloads that announce much, and such that inflate to a gigabyte."""
    whole = payload(name)
    bomb = zlib.compress(bytes(2**26), 9)
    yield from (bomb, whole[:36] + bomb)
    if name == "voxels":
        yield struct.pack("<d3i3II", 0.2, 0, 0, 0, 1023, 1024, 1024, 2**20) + bomb
        yield struct.pack("<d3i3II", 0.2, 0, 0, 0, 2**16, 2**16, 1, 2**32 - 1) + bomb
    if name in ("features", "sparse_features"):
        yield struct.pack("<B3HI", 0, 256, 256, 256, 0)
        yield struct.pack("<B3HI", 0, 0, 65535, 65535, 0)
    if name == "cpm":
        yield b"\xff" * 2**15
        yield bytes(2**15)


@EVERY
def test_no_payload_takes_more_memory_than_is_declared(name: str) -> None:
    codec = decoder(name)
    codec.decode(payload(name))  # what is made once is not the payload's
    dropped = list(bombs(name))
    assert dropped
    tracemalloc.start()
    try:
        for bomb in dropped:
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            with contextlib.suppress(CodecError):
                codec.decode(bomb)
            assert tracemalloc.get_traced_memory()[1] - before <= codec.limit_bytes
    finally:
        tracemalloc.stop()


def largest(name: str) -> bytes:
    """As many objects as two bytes count, or as many values as are decoded at most."""
    if name in ("features", "sparse_features"):
        cells = np.ones((1024, 1024), np.float32)
        full = FeatureMap(np.ones((16, *cells.shape), np.float32), some_grid(*cells.shape), cells)
        return (SparseFeaturesCodec(most_cells=2**20) if name == "sparse_features" else FeaturesCodec()).encode(full)
    if name == "queries":
        return decoder(name).encode(some_queries(65_535, width=256))
    if name == "detections":
        found = some_detections(65_535)
        return decoder(name).encode(replace(found, embedding=np.ones((65_535, 64))))
    return decoder(name).encode(SAMPLES[name]({"cpm": 255, "points": 2**20, "voxels": 2**20}.get(name, 65_535)))


@EVERY
def test_the_largest_payload_takes_no_more_memory_than_is_declared(name: str) -> None:
    sent = largest(name)
    tracemalloc.start()
    try:
        decoder(name).decode(sent)
        assert tracemalloc.get_traced_memory()[1] <= decoder(name).limit_bytes
    finally:
        tracemalloc.stop()


class Plain(Codec[bytes]):
    """A sound codec: two bytes of length, then the content."""

    content = "plain"
    limit_bytes = 2**17

    def encode(self, content: bytes) -> bytes:
        if len(content) > 0xFFFF:
            raise CodecError("too long")
        return struct.pack("<H", len(content)) + content

    def decode(self, payload: bytes) -> Any:
        if len(payload) < 2 or len(payload) != 2 + struct.unpack_from("<H", payload)[0]:
            raise CodecError(f"{len(payload)} bytes are none")
        return payload[2:]


class RaisesOtherErrors(Plain):
    def decode(self, payload: bytes) -> Any:
        struct.unpack_from("<H", payload)
        return super().decode(payload)


class TakesAnyLength(Plain):
    def decode(self, payload: bytes) -> Any:
        return payload[2:]


class TakesMoreAfterwards(Plain):
    def decode(self, payload: bytes) -> Any:
        size = struct.unpack_from("<H", payload)[0] if len(payload) > 1 else 0
        return super().decode(payload[: 2 + size])


class TakesMuchMemory(Plain):
    def decode(self, payload: bytes) -> Any:
        if len(payload) > 1:
            bytearray(100 * struct.unpack_from("<H", payload)[0])
        return super().decode(payload)


class Writable(Plain):
    def encode(self, content: Any) -> bytes:
        return super().encode(bytes(content))

    def decode(self, payload: bytes) -> Any:
        return np.frombuffer(super().decode(payload), np.uint8).copy()


class Drifting(Plain):
    def encode(self, content: bytes) -> bytes:
        return super().encode(content + b"x")


class Greedy(Plain):
    def encode_within(self, content: bytes, budget_bytes: int) -> bytes:
        return self.encode(content if budget_bytes > 1 else b"")


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """The wrong codecs, as if they were registered."""
    classes = [Plain, *Plain.__subclasses__()]
    monkeypatch.setattr(CODECS, "_entries", CODECS._entries | {each.__name__: each for each in classes})


PLAIN = [b"", b"a", b"abcdefghi" * 5]


@pytest.mark.usefixtures("registered")
def test_a_sound_codec_passes() -> None:
    for codec in (Plain, Plain(), "Plain"):
        check_codec(codec, PLAIN)


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(
    ("codec", "match"),
    [
        (RaisesOtherErrors, "RaisesOtherErrors must refuse bytes by CodecError, got error for b''"),
        (TakesAnyLength, "TakesAnyLength must refuse a payload cut off at"),
        (TakesMoreAfterwards, "TakesMoreAfterwards must refuse 1 bytes after a payload"),
        (TakesMuchMemory, "TakesMuchMemory declares limit_bytes 131072, and took"),
        (Writable, "Writable: decoded arrays must be read-only, content is not"),
        (Drifting, "Drifting must be stable once content was encoded"),
        (Greedy, "Greedy must keep within a budget of"),
    ],
)
def test_what_is_wrong_is_found(codec: type[Codec[Any]], match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_codec(codec, PLAIN)


def test_a_codec_that_nobody_could_look_up_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown codec class 'Plain'"):
        check_codec(Plain, PLAIN)
    with pytest.raises(UnknownNameError, match=r"unknown codec 'voxel'. Did you mean 'voxels'"):
        check_codec("voxel", PLAIN)
