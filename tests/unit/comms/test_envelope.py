"""What is encoded comes back, and what is not a message is refused by name."""

import contextlib
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.comms.codecs.detection_codec import DetectionsCodec
from coopsim.comms.envelope import decode_detections, decode_message, encode_message
from coopsim.errors import CodecError, InvalidValueError
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


def test_a_message_names_its_sender() -> None:
    """Nobody's would stand for what the receiver measured itself."""
    with pytest.raises(InvalidValueError, match="sender must be an agent's name"):
        replace(message(), sender="")
    wire = bytearray(encode_message(message()))
    content = wire[4:]  # after the checksum
    content[0] = 0  # the length of its name
    del content[1 + 1 + 8 + 32 + 4 : 1 + 1 + 8 + 32 + 4 + len("cav_0")]
    with pytest.raises(CodecError, match="names no sender"):
        decode_message(struct.pack("<I", zlib.crc32(content)) + bytes(content))


def test_other_content_is_refused() -> None:
    with pytest.raises(CodecError, match="carries 'points', not 'detections'"):
        decode_detections(message(codec="points"))


def test_a_label_out_of_range_is_refused() -> None:
    payload = bytearray(DetectionsCodec().encode(detections(1)))
    payload[-1] = 200
    with pytest.raises(CodecError, match="label 200"):
        DetectionsCodec().decode(bytes(payload))


def looking(count: int, width: int, seed: int = 0) -> Detections:
    return replace(detections(count), embedding=np.random.default_rng(seed).normal(0, 20, (count, width)))


@pytest.mark.parametrize(("count", "width"), [(1, 1), (3, 7), (40, 1024)])
def test_embeddings_come_back_in_direction_and_their_bytes_are_counted(count: int, width: int) -> None:
    sent = looking(count, width)
    payload = DetectionsCodec().encode(sent)
    assert len(payload) == 2 + 33 * count + 2 + 2 * width * count
    got = decode_detections(message(payload))
    assert sent.embedding is not None and got.embedding is not None
    unit = sent.embedding / np.linalg.norm(sent.embedding, axis=1, keepdims=True)
    np.testing.assert_allclose((got.embedding * unit).sum(axis=1), 1, atol=1e-3)


@pytest.mark.parametrize("embedding", [None, np.full((3, 4), np.nan), np.zeros((3, 4)), np.zeros((3, 0))])
def test_without_a_usable_embedding_a_message_keeps_its_bytes(embedding: object) -> None:
    codec, plain = DetectionsCodec(), detections(3)
    payload = codec.encode(replace(plain, embedding=embedding))
    assert payload == codec.encode(plain) and codec.decode(payload).embedding is None


def test_what_is_no_embedding_arrives_as_zeros_and_any_length_survives() -> None:
    rows = np.array([[np.nan, 1], [np.inf, 1], [0, 0], [3e300, 4e300], [3e-300, 4e-300]])
    got = DetectionsCodec().decode(DetectionsCodec().encode(replace(detections(5), embedding=rows)))
    np.testing.assert_allclose(got.embedding, [[0, 0]] * 3 + [[0.6, 0.8]] * 2, atol=1e-3)


def test_broken_embeddings_are_refused() -> None:
    codec = DetectionsCodec()
    payload = codec.encode(looking(2, 3))
    head = 2 + 33 * 2
    for broken in (
        *(payload[:length] for length in range(head + 1, len(payload))),
        payload + b"\0",
        payload[:head] + b"\0\0",
        payload[:head] + b"\xff\xff" + payload[head + 2 :],
        codec.encode(detections(0)) + b"\x01\0",
    ):
        with pytest.raises(CodecError, match=r"are not an embedding for each|are not the velocities of"):
            codec.decode(broken)
    for value in (np.inf, np.nan):
        with pytest.raises(CodecError, match="must be finite"):
            codec.decode(payload[:-2] + np.float16(value).tobytes())
    with pytest.raises(CodecError, match="at most 4096 elements, got 4097"):
        codec.encode(looking(1, 4097))
    widest = codec.decode(codec.encode(looking(1, 4096))).embedding
    assert widest is not None and widest.shape == (1, 4096)


@given(st.binary(max_size=60), st.integers(0, 3))
def test_random_bytes_after_detections_are_refused_or_finite(noise: bytes, count: int) -> None:
    with contextlib.suppress(CodecError):
        got = DetectionsCodec().decode(DetectionsCodec().encode(detections(count)) + noise)
        assert got.embedding is None or np.isfinite(got.embedding).all()


def test_a_covariance_is_24_bytes_more_and_comes_back() -> None:
    covariance = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.0], [0.1, 0.0, 0.25]])
    plain = Message("cav_0", 1, PoseEstimate(np.zeros(4)), b"payload", "detections")
    stated = Message("cav_0", 1, PoseEstimate(np.zeros(4), covariance), b"payload", "detections")
    assert len(encode_message(plain)) == 50 + len("cav_0") + len("detections") + len(b"payload")
    assert len(encode_message(stated)) == len(encode_message(plain)) + 24
    got = decode_message(encode_message(stated))
    assert got.payload == b"payload"
    np.testing.assert_allclose(got.pose.covariance, covariance, rtol=1e-6)
    assert decode_message(encode_message(plain)).pose.covariance is None


@pytest.mark.parametrize("wrong", [np.nan, -1.0])
def test_a_covariance_that_is_none_is_refused(wrong: float) -> None:
    broken = Message("cav_0", 1, PoseEstimate(np.zeros(4), np.diag([wrong, 1.0, 1.0])), b"", "detections")
    with pytest.raises(CodecError, match="covariance of the sender's pose must be finite and not negative"):
        decode_message(encode_message(broken))
