"""A message is decoded once, whoever asks, and what is remembered is bounded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.comms.decode_once import DecodeOnce, size_bytes
from coopsim.errors import CodecError
from coopsim.types import FeatureMap, Message, PoseEstimate
from coopsim.types.features import BevGrid


def message(payload: bytes = b"boxes", **changes: object) -> Message:
    return replace(Message("cav_0", 5, PoseEstimate(np.zeros(4)), payload, "detections"), **changes)  # type: ignore[arg-type]


class Decoder:
    """Counts its calls; refuses what begins with an exclamation mark."""

    def __init__(self, size: int = 10) -> None:
        self.calls, self._size = 0, size

    def __call__(self, heard: Message) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
        self.calls += 1
        if heard.payload.startswith(b"!"):
            raise CodecError("that is none")
        return np.zeros(self._size, np.uint8)


def test_equal_messages_are_decoded_once_whatever_happens_in_between() -> None:
    decoded, decode = DecodeOnce(), Decoder()
    first = decoded(message(), decode)
    for other in range(50):
        decoded(message(b"other %d" % other), decode)
    copy = message(bytes(bytearray(b"boxes")))  # as it is unpacked for another receiver, or comes a second time
    assert decoded(copy, decode) is first and decode.calls == 51


@pytest.mark.parametrize(
    "changes",
    [
        {"payload": b"other"},
        {"sender": "cav_1"},
        {"captured_ns": 6},
        {"codec": "compact"},
        {"pose": PoseEstimate(np.array([1.0, 0, 0, 0]))},
    ],
)
def test_unlike_messages_are_decoded_each(changes: dict[str, object]) -> None:
    decoded, decode, other = DecodeOnce(), Decoder(), Decoder()
    decoded(message(), decode)
    decoded(message(**changes), decode)  # type: ignore[arg-type]
    assert decode.calls == 2
    decoded(message(), other)
    assert other.calls == 1


def test_what_cannot_be_read_is_tried_once_and_refused_always() -> None:
    decoded, decode = DecodeOnce(), Decoder()
    for _ in range(3):
        with pytest.raises(CodecError, match="that is none"):
            decoded(message(b"!"), decode)
    assert decode.calls == 1


def test_memory_is_bounded_and_the_least_recently_used_goes_first() -> None:
    decoded, decode = DecodeOnce(most_bytes=1_000_000), Decoder(size=100_000)
    for number in range(100):
        decoded(message(b"%d" % number), decode)
        decoded(message(b"0"), decode)  # asked all the time, so it is never forgotten
    assert decode.calls == 100
    decoded(message(b"1"), decode)
    assert decode.calls == 101
    assert decoded._bytes <= 1_000_000 and len(decoded._known) <= 10


def test_small_messages_are_forgotten_too() -> None:
    decoded, decode = DecodeOnce(most_messages=10), Decoder()
    for number in range(100):
        decoded(message(b"%d" % number), decode)
    assert len(decoded._known) == 10 and decoded._bytes == sum(size for _, _, size in decoded._known.values())


def test_a_content_larger_than_the_memory_is_decoded_all_the_same() -> None:
    decoded, decode = DecodeOnce(most_bytes=1000), Decoder(size=10_000)
    for _ in range(2):
        assert len(decoded(message(), decode)) == 10_000
    assert decode.calls == 2 and not decoded._known


def test_sizes_are_those_of_all_arrays() -> None:
    grid = BevGrid((0, 2), (0, 1), 0.5)
    features = FeatureMap(np.zeros((3, 2, 4)), grid, np.zeros((2, 4)))
    assert size_bytes(features) == 4 * (24 + 8)
    assert size_bytes({"a": [b"abc", (features,)], "b": 5}) == 3 + 128
