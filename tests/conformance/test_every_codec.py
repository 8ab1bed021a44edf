"""What every registered codec withstands: bytes from anywhere.

They are decoded or refused by `CodecError`, never worse, and never take more memory than the codec declares.
"""

from __future__ import annotations

import contextlib
import random
import struct
import tracemalloc
import zlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from codec_samples import SAMPLES, some_detections, some_grid, some_queries
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.codecs.codec import CODECS, decoder
from coopsim.comms.codecs.feature_codec import FeaturesCodec
from coopsim.comms.codecs.sparse_feature_codec import SparseFeaturesCodec
from coopsim.errors import CodecError
from coopsim.types import FeatureMap

EVERY = pytest.mark.parametrize("name", CODECS.names())


def payload(name: str, count: int = 5) -> bytes:
    return decoder(name).encode(SAMPLES[name](count))


def attempt(name: str, noise: bytes) -> bool:
    """Whether it was decoded; what was can be encoded again."""
    try:
        content = decoder(name).decode(noise)
    except CodecError:
        return False
    decoder(name).encode(content)
    return True


def test_every_codec_has_a_sample() -> None:
    assert set(SAMPLES) == set(CODECS.names())


@EVERY
@pytest.mark.parametrize("count", [0, 1, 5])
def test_a_second_trip_changes_nothing(name: str, count: int) -> None:
    sent = payload(name, count)
    again = decoder(name).encode(decoder(name).decode(sent))
    assert decoder(name).encode(decoder(name).decode(again)) == again
    assert abs(len(again) - len(sent)) <= 8  # zlib may take a byte more or less


@EVERY
def test_every_truncation_and_every_addition_is_refused(name: str) -> None:
    whole = payload(name)
    assert attempt(name, whole)
    for length in range(len(whole)):
        assert not attempt(name, whole[:length]), length
    for more in (b"\0", b"\xff", whole, bytes(1_000_000)):
        assert not attempt(name, whole + more)


@EVERY
def test_every_flipped_bit_is_refused_or_decoded_never_worse(name: str) -> None:
    whole = payload(name, 3)
    positions = list(range(8 * len(whole)))
    for position in random.Random(0).sample(positions, min(len(positions), 1500)):
        broken = bytearray(whole)
        broken[position // 8] ^= 1 << position % 8
        attempt(name, bytes(broken))


@EVERY
@settings(max_examples=60)
@given(noise=st.binary(max_size=300), kept=st.integers(0, 40))
def test_random_bytes_are_refused_or_decoded_never_worse(name: str, noise: bytes, kept: int) -> None:
    attempt(name, noise)
    attempt(name, payload(name, 2)[:kept] + noise)  # past the head


def bombs(name: str) -> Iterator[bytes]:
    """Small payloads that announce much: every field of the head at its most, and what inflates to a gigabyte."""
    whole = payload(name)
    for at in range(min(len(whole), 40)):
        for width in (1, 2, 4):
            yield whole[:at] + b"\xff" * width + whole[at + width :]
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
    attempt(name, payload(name))  # what is made once is not the payload's
    tracemalloc.start()
    try:
        for bomb in bombs(name):
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
