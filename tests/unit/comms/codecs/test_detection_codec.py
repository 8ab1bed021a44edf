"""Compact detections come back within their stated errors, and what is out of range is refused or left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from codec_samples import some_covariances, some_detections, some_velocities
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.codecs.cpm_codec import CpmCodec
from coopsim.comms.codecs.detection_codec import CompactDetectionsCodec as Codec
from coopsim.comms.codecs.detection_codec import DetectionsCodec
from coopsim.comms.codecs.point_codec import VoxelsCodec
from coopsim.comms.codecs.track_codec import TracksCodec
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import wrap_angle
from coopsim.types import Detections

QUICK = settings(max_examples=60)
CODEC = Codec()
FLOAT = 1e-9  # of float64, in the places where an error may be exactly as large as stated


def number(least: float, most: float) -> st.SearchStrategy[float]:
    return st.floats(least, most, allow_nan=False)


OBJECT = st.tuples(
    *[number(-327.67, 327.67)] * 3,
    *[number(0.01, 655.35)] * 3,
    number(-100, 100),
    number(-65504, 65504),
    st.integers(0, 8),
)


def detections(rows: list[tuple[Any, ...]]) -> Detections:
    table = np.array(rows, dtype=float).reshape(-1, 9)
    return Detections(Boxes3D.from_array(table[:, :7]), table[:, 7], table[:, 8].astype(int))


def test_the_codecs_state_the_errors_of_the_page() -> None:
    """The bounds of all tests of codecs are those of docs/reference/codecs.md."""
    assert (Codec.CENTER_ERROR_M, Codec.SIZE_ERROR_M, Codec.SCORE_ERROR) == (0.005, 0.005, 2.0**-11)
    assert np.radians(0.003) >= Codec.YAW_ERROR_RAD and Codec.SIGMA_ERROR <= 0.028 and Codec.RHO_ERROR == 1 / 127
    of_cpm = (CpmCodec.CENTER_ERROR_M, CpmCodec.SIZE_ERROR_M, CpmCodec.YAW_ERROR_RAD, CpmCodec.POSITION_ERROR_M)
    assert of_cpm == pytest.approx((0.005, 0.05, np.radians(0.05), 0.0055660745), abs=2e-6)
    assert (CpmCodec.SCORE_ERROR, CpmCodec.TIME_ERROR_NS) == (0.005, 500_000)
    assert DetectionsCodec.RELATIVE_ERROR == TracksCodec.RELATIVE_ERROR == 2.0**-24
    assert VoxelsCodec(0.2).error_m(100.0) == pytest.approx(0.1, abs=1e-5)


@QUICK
@given(st.lists(OBJECT, max_size=8))
def test_all_that_is_in_range_comes_back_within_the_stated_errors(rows: list[tuple[Any, ...]]) -> None:
    sent = detections(rows)
    assert CODEC.sendable(sent).all()
    payload = CODEC.encode(sent)
    got = CODEC.decode(payload)
    assert len(payload) == 3 + 17 * len(rows)
    assert np.abs(got.boxes.center - sent.boxes.center).max(initial=0) <= 0.005 + FLOAT
    assert np.abs(got.boxes.size - sent.boxes.size).max(initial=0) <= 0.005 + FLOAT
    assert np.abs(wrap_angle(got.boxes.yaw - sent.boxes.yaw)).max(initial=0) <= np.radians(0.003) + FLOAT
    bound = np.maximum(np.abs(sent.score) * 2.0**-11, 2.0**-25)
    assert (np.abs(got.score - sent.score) <= bound + FLOAT).all()
    np.testing.assert_array_equal(got.label, sent.label)
    assert got.covariance is None and CODEC.encode(got) == payload


@QUICK
@given(st.integers(0, 2**32 - 1))
def test_uncertainties_come_back_within_the_stated_errors_and_stay_covariances(seed: int) -> None:
    sent = replace(some_detections(6), covariance=some_covariances(6, seed))
    payload = CODEC.encode(sent)
    got = CODEC.decode(payload)
    assert len(payload) == 3 + 25 * 6
    assert sent.covariance is not None and got.covariance is not None
    sigma, back = (np.sqrt(np.diagonal(each, axis1=1, axis2=2)) for each in (sent.covariance, got.covariance))
    assert (np.abs(back / sigma - 1) <= 0.028 + FLOAT).all()
    rho, rho_back = (
        each[:, 0, 1] / (deviation[:, 0] * deviation[:, 1])
        for each, deviation in ((sent.covariance, sigma), (got.covariance, back))
    )
    assert (np.abs(rho_back - rho) <= 1 / 127 + FLOAT).all()
    assert np.linalg.eigvalsh(got.covariance).min() > 0
    np.testing.assert_allclose(got.covariance, got.covariance.transpose(0, 2, 1))


@pytest.mark.parametrize("codec", [CODEC, DetectionsCodec()])
@pytest.mark.parametrize("sure", [False, True])
def test_velocities_come_back_within_half_a_centimetre_a_second(codec: Any, sure: bool) -> None:
    still = some_detections(7, sure=sure)
    velocity = np.vstack([some_velocities(np.random.default_rng(4), 5), [[327.67, -327.67], [0.0, 327.68]]])
    payload = codec.encode(replace(still, velocity=velocity))
    got = codec.decode(payload).velocity
    known = np.isfinite(velocity).all(axis=1) & (np.arange(7) < 6)
    assert known.sum() == 4
    np.testing.assert_array_equal(np.isfinite(got).all(axis=1), known)
    assert np.abs(got - velocity)[known].max() <= 0.005 + FLOAT
    marker = 2 if isinstance(codec, DetectionsCodec) else 0
    assert len(payload) == len(codec.encode(still)) + marker + 7 * 4
    with pytest.raises(CodecError):
        codec.decode(payload[:-1])
    assert codec.encode(replace(still, velocity=np.full((7, 2), np.nan))) == codec.encode(still)


def test_velocities_stand_before_embeddings() -> None:
    codec, velocity = DetectionsCodec(), np.full((3, 2), 1.5)
    got = codec.decode(codec.encode(replace(some_detections(3), velocity=velocity, embedding=np.eye(3, 5))))
    np.testing.assert_allclose(got.velocity, velocity)
    np.testing.assert_allclose(got.embedding, np.eye(3, 5))


def test_uncertainties_beyond_the_range_saturate() -> None:
    extreme = np.zeros((3, 7, 7))
    extreme[1] = np.diag([1e12] * 7)
    extreme[2, :2, :2] = [[4.0, 4.0], [4.0, 4.0]]  # x and y are the same: singular
    got = CODEC.decode(CODEC.encode(replace(some_detections(3), covariance=extreme))).covariance
    assert got is not None
    sigma = np.sqrt(np.diagonal(got, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma[0], 1e-3)
    np.testing.assert_allclose(sigma[1], 1e3)
    assert np.linalg.eigvalsh(got).min() > 0


UNFIT: dict[str, Callable[[np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any]], None]] = {
    "far away": lambda rows, score, label: rows.__setitem__((1, 0), 327.7),
    "not finite": lambda rows, score, label: rows.__setitem__((1, 2), np.nan),
    "beyond float32": lambda rows, score, label: rows.__setitem__((1, 1), 1e300),
    "no heading": lambda rows, score, label: rows.__setitem__((1, 6), np.inf),
    "no size": lambda rows, score, label: rows.__setitem__((1, 4), 0.001),
    "too long": lambda rows, score, label: rows.__setitem__((1, 3), 655.4),
    "no score": lambda rows, score, label: score.__setitem__(1, np.nan),
    "a huge score": lambda rows, score, label: score.__setitem__(1, 1e6),
    "no class": lambda rows, score, label: label.__setitem__(1, 9),
}


@pytest.mark.parametrize("what", UNFIT)
def test_what_is_out_of_range_is_refused_and_can_be_left_out(what: str) -> None:
    good = some_detections(3)
    rows, score, label = good.boxes.array.copy(), good.score.copy(), good.label.copy()
    UNFIT[what](rows, score, label)
    unfit = Detections(Boxes3D.from_array(rows), score, label)
    with pytest.raises(CodecError, match=r"detection 1 cannot be sent: accepted are finite centres within 327.67 m"):
        CODEC.encode(unfit)
    assert CODEC.sendable(unfit).tolist() == [True, False, True]
    assert len(CODEC.decode(CODEC.encode(unfit[CODEC.sendable(unfit)]))) == 2


@pytest.mark.parametrize("wrong", [np.nan, -1.0])
def test_a_covariance_that_is_none_is_refused(wrong: float) -> None:
    covariance = some_covariances(3)
    covariance[1, 2, 2] = wrong
    assert CODEC.sendable(replace(some_detections(3), covariance=covariance)).tolist() == [True, False, True]


def test_of_too_many_the_surest_are_sent() -> None:
    many = some_detections(1)[np.zeros(70_000, dtype=int)]
    many = replace(many, score=np.arange(70_000) / 70_000)
    sent = CODEC.sendable(many)
    assert sent.sum() == 65_535 and sent[-65_535:].all()
    with pytest.raises(CodecError, match="at most 65535 detections, got 70000"):
        CODEC.encode(many)
