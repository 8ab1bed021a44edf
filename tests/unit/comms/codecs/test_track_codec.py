"""Tracks come back to the codec's precision, and what is no message of tracks is refused by name."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coopsim.comms.codecs.track_codec import TracksCodec, sendable
from coopsim.comms.envelope import decode_tracks, encode_message
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Message, PoseEstimate, Tracks
from coopsim.types.track_estimates import TrackEstimates

FLOAT32 = 2.0**-24  # half a unit in the last place, relative
ROW = 85
AT = {"id": 0, "center": 4, "size": 16, "yaw": 28, "velocity": 32, "score": 40, "label": 44, "covariance": 45}


def estimates(count: int, seed: int = 0) -> TrackEstimates:
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-150, 150, (count, 7))
    rows[:, 3:6] = rng.uniform(0.3, 12, (count, 3))
    axes = np.linalg.qr(rng.normal(size=(count, 4, 4)))[0]
    covariance = axes * (10.0 ** rng.uniform(-3, 3, (count, 1, 4))) @ axes.transpose(0, 2, 1)
    ids = rng.choice(2**32, count, replace=False) if count else np.zeros(0, dtype=np.int64)
    velocity, score = rng.normal(0, 15, (count, 2)), rng.random(count)
    tracks = Tracks(ids, Boxes3D.from_array(rows), velocity, score, rng.integers(0, 9, count))
    return TrackEstimates(tracks, (covariance + covariance.transpose(0, 2, 1)) / 2)


def message(payload: bytes, codec: str = "tracks") -> Message:
    return Message("cav_0", 5, PoseEstimate(np.zeros(4)), payload, codec)


@pytest.mark.parametrize("count", [0, 1, 40])
def test_tracks_come_back_within_float32(count: int) -> None:
    sent = estimates(count)
    payload = TracksCodec().encode(sent)
    got = decode_tracks(message(payload))
    assert len(payload) == 2 + ROW * count
    np.testing.assert_array_equal(got.tracks.id, sent.tracks.id)
    np.testing.assert_array_equal(got.tracks.label, sent.tracks.label)
    for ours, theirs in (
        (got.tracks.boxes.array, sent.tracks.boxes.array),
        (got.tracks.velocity, sent.tracks.velocity),
        (got.tracks.score, sent.tracks.score),
        (got.covariance, sent.covariance),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=FLOAT32, atol=1e-30)
    assert TracksCodec().encode(got) == payload


@given(st.integers(0, 2**32 - 1))
def test_the_covariance_that_comes_back_is_as_sure_as_the_one_sent(seed: int) -> None:
    sent = estimates(5, seed)
    got = TracksCodec().decode(TracksCodec().encode(sent))
    assert np.linalg.eigvalsh(got.covariance).min() > 0
    np.testing.assert_allclose(got.covariance, got.covariance.transpose(0, 2, 1))
    scale = np.abs(sent.covariance).max(axis=(1, 2))
    assert (np.abs(got.covariance - sent.covariance).max(axis=(1, 2)) <= FLOAT32 * scale).all()


@given(st.binary(max_size=400))
def test_random_bytes_are_refused_or_decoded_never_worse(noise: bytes) -> None:
    counted = struct.pack("<H", len(noise) // ROW) + noise[: len(noise) // ROW * ROW]
    for payload in (noise, counted):
        with contextlib.suppress(CodecError):
            assert sendable(TracksCodec().decode(payload)).all()


@example(177, 127)  # a signalling NaN
@example(48, 127)  # one among the covariances
@given(st.integers(0, 3 * ROW - 1), st.integers(0, 255))
def test_one_changed_byte_is_refused_or_decoded_never_worse(position: int, value: int) -> None:
    payload = bytearray(TracksCodec().encode(estimates(3)))
    payload[2 + position] = value
    with contextlib.suppress(CodecError):
        assert sendable(TracksCodec().decode(bytes(payload))).all()


def test_every_truncation_and_every_addition_is_refused() -> None:
    payload = TracksCodec().encode(estimates(3))
    for length in range(len(payload)):
        with pytest.raises(CodecError, match="whole number of tracks"):
            TracksCodec().decode(payload[:length])
    for more in (b"\x00", payload[2 : 2 + ROW], bytes(1_000_000)):
        with pytest.raises(CodecError, match="whole number of tracks"):
            TracksCodec().decode(payload + more)


def hostile(field: str, value: float, offset: int = 0, row: int = 1) -> bytes:
    payload = bytearray(TracksCodec().encode(estimates(3)))
    kind = {"id": "<I", "label": "<B"}.get(field, "<f")
    struct.pack_into(kind, payload, 2 + row * ROW + AT[field] + offset, value)
    return bytes(payload)


@pytest.mark.parametrize(
    "payload",
    [
        *(hostile(field, value) for field in ("center", "yaw", "velocity", "score") for value in (np.nan, np.inf)),
        *(hostile("size", value) for value in (0.0, -1.0, np.nan)),
        hostile("label", 9),
        *(hostile("covariance", value) for value in (np.nan, -np.inf, 0.0, -1.0, 3e38, 2e7, 1e-9)),
        hostile("covariance", 1e6, offset=4),  # a covariance above both variances
    ],
)
def test_what_is_no_track_is_refused_by_its_number(payload: bytes) -> None:
    with pytest.raises(CodecError, match=r"track 1 is invalid: accepted are .* eigenvalues in \[1e-06, 1e\+07\]"):
        TracksCodec().decode(payload)


def test_an_id_twice_is_refused() -> None:
    twice = hostile("id", int(estimates(3).tracks.id[0]))
    with pytest.raises(CodecError, match="unique within a message"):
        TracksCodec().decode(twice)


def test_other_content_is_refused() -> None:
    with pytest.raises(CodecError, match="carries 'detections', not 'tracks'"):
        decode_tracks(message(b"", codec="detections"))


UNFIT: list[Callable[[TrackEstimates], Any]] = [
    lambda e: replace(e, tracks=replace(e.tracks, id=[1, 2**32, 3])),
    lambda e: replace(e, tracks=replace(e.tracks, id=[1, -2, 3])),
    lambda e: replace(e, tracks=replace(e.tracks, label=[0, 9, 0])),
    lambda e: replace(e, tracks=replace(e.tracks, score=[0, 1e39, 0])),
    lambda e: replace(e, tracks=replace(e.tracks, velocity=[[0, 0], [np.nan, 0], [0, 0]])),
    lambda e: replace(
        e, tracks=replace(e.tracks, boxes=Boxes3D(e.mean[:, :3], [[1] * 3, [1, 1e-50, 1], [1] * 3], [0] * 3))
    ),
    lambda e: replace(e, covariance=e.covariance * np.array([1, -1, 1])[:, None, None]),
    lambda e: replace(e, covariance=e.covariance * np.array([1, 1e200, 1])[:, None, None]),
]


@pytest.mark.parametrize("spoil", UNFIT)
def test_what_cannot_be_sent_is_refused_and_can_be_left_out(spoil: Callable[[TrackEstimates], Any]) -> None:
    unfit = spoil(estimates(3))
    with pytest.raises(CodecError, match="track 1 cannot be sent: accepted are ids"):
        TracksCodec().encode(unfit)
    assert sendable(unfit).tolist() == [True, False, True]
    assert len(TracksCodec().decode(TracksCodec().encode(unfit[sendable(unfit)]))) == 2


def test_too_many_tracks_are_refused() -> None:
    many = estimates(1)[np.zeros(2**16, dtype=int)]
    with pytest.raises(CodecError, match="at most 65535 tracks, got 65536"):
        TracksCodec().encode(many)


def test_what_a_message_weighs() -> None:
    payload = TracksCodec().encode(estimates(10))
    assert len(encode_message(message(payload))) == 50 + len("cav_0") + len("tracks") + 2 + 85 * 10
