"""What is encoded comes back, and what is not a message is refused by name."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.comms.message import DetectionsCodec, decode_detections, decode_message, encode_message
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, Message, PoseEstimate


def detections(count: int, seed: int = 0) -> Detections:
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-50, 50, (count, 7))
    rows[:, 3:6] = rng.uniform(0.3, 12, (count, 3))
    return Detections(Boxes3D.from_array(rows), rng.random(count), rng.integers(0, 9, count))


def message(payload: bytes = b"abc", codec: str = "detections") -> Message:
    return Message("cav_0", 1_234_567_890, PoseEstimate(np.array([1.0, -2.0, 0.0, 0.5])), payload, codec)


@pytest.mark.parametrize("count", [0, 1, 40])
def test_detections_come_back_within_float32(count: int) -> None:
    sent = detections(count)
    payload = DetectionsCodec().encode(sent)
    got = decode_detections(message(payload))
    np.testing.assert_allclose(got.boxes.array, sent.boxes.array, rtol=1e-6)
    np.testing.assert_allclose(got.score, sent.score, rtol=1e-6)
    np.testing.assert_array_equal(got.label, sent.label)
    assert len(payload) == 2 + 33 * count


def test_envelope_comes_back_exactly() -> None:
    sent = message()
    got = decode_message(encode_message(sent))
    assert (got.sender, got.captured_ns, got.payload, got.codec) == (
        "cav_0",
        1_234_567_890,
        b"abc",
        "detections",
    )
    np.testing.assert_array_equal(got.pose.xyz_yaw, sent.pose.xyz_yaw)


def test_every_truncation_is_refused() -> None:
    wire = encode_message(message(DetectionsCodec().encode(detections(3))))
    for length in range(len(wire)):
        with pytest.raises(CodecError):
            decode_message(wire[:length])


@given(st.binary(max_size=200))
def test_random_bytes_are_refused_or_decoded_never_worse(noise: bytes) -> None:
    for decode in (decode_message, DetectionsCodec().decode):
        with contextlib.suppress(CodecError):
            decode(noise)


def test_other_content_is_refused() -> None:
    with pytest.raises(CodecError, match="carries 'points', not 'detections'"):
        decode_detections(message(codec="points"))


def test_a_label_out_of_range_is_refused() -> None:
    payload = bytearray(DetectionsCodec().encode(detections(1)))
    payload[-1] = 200
    with pytest.raises(CodecError, match="label 200"):
        DetectionsCodec().decode(bytes(payload))
