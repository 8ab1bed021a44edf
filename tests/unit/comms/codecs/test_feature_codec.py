"""Features, dense and sparse, and queries come back within their stated errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from codec_samples import some_features, some_grid, some_queries
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from coopsim.comms.codecs.feature_codec import FEATURE_NUMBERS, FeatureNumber, FeaturesCodec, SparseFeaturesCodec
from coopsim.comms.codecs.query_codec import QueriesCodec
from coopsim.errors import CodecError, InvalidValueError, UnknownNameError
from coopsim.types import FeatureMap, InstanceQueries

QUICK = settings(max_examples=60)
BYTES = {"float32": 4, "float16": 2, "int8": 1}
EVERY_NUMBER = pytest.mark.parametrize("number", FEATURE_NUMBERS)

VALUES = st.one_of(st.floats(-60_000, 60_000, width=32), st.sampled_from([0.0, 1e-30, -1.0, 1e-44]))
MAPS = st.tuples(st.integers(0, 4), st.integers(1, 5), st.integers(1, 5)).flatmap(
    lambda shape: st.tuples(
        arrays(np.float32, shape, elements=VALUES), arrays(np.float32, shape[1:], elements=st.floats(0, 1, width=32))
    )
)


def feature_error(values: np.ndarray[Any, Any], number: str) -> np.ndarray[Any, Any]:
    """How far values (R, M) may come back from what they were, by row (R, 1)."""
    largest = np.abs(values).max(axis=1, keepdims=True, initial=0.0).astype(np.float64)
    bounds = {"float32": 0 * largest, "float16": largest * 2.0**-11 + 2.0**-25, "int8": largest / 253 + 1e-38}
    return bounds[number]


def feature_map(values: Any, confidence: Any = None) -> FeatureMap:
    values = np.asarray(values, dtype=np.float32)
    return FeatureMap(values, some_grid(*values.shape[1:]), confidence)


def by_row(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return values.reshape(len(values), -1) if values.size else values.reshape(len(values), 0)


@EVERY_NUMBER
@QUICK
@given(content=MAPS, stated=st.booleans())
def test_dense_maps_come_back_within_the_stated_errors(number: FeatureNumber, content: Any, stated: bool) -> None:
    values, confidence = content
    sent = feature_map(values, confidence if stated else None)
    payload = FeaturesCodec(number).encode(sent)
    got = FeaturesCodec().decode(payload)
    scales = 4 * len(values) if number == "int8" else 0
    assert len(payload) == 53 + scales + BYTES[number] * values.size + stated * confidence.size
    assert (np.abs(by_row(got.values) - by_row(values)) <= feature_error(by_row(values), number)).all()
    assert got.grid == sent.grid
    assert (got.confidence is not None) == stated
    if got.confidence is not None:
        assert np.abs(got.confidence - confidence).max() <= 0.5 / 255 + 1e-6


@EVERY_NUMBER
@QUICK
@given(content=MAPS, most=st.integers(0, 12), least=st.floats(0, 1))
def test_of_sparse_maps_the_surest_cells_come_back(
    number: FeatureNumber, content: Any, most: int, least: float
) -> None:
    sent, codec = feature_map(*content), SparseFeaturesCodec(most, least, number)
    payload = codec.encode(sent)
    got = SparseFeaturesCodec().decode(payload)
    assert sent.confidence is not None and got.confidence is not None
    sure = sent.confidence.ravel()
    order = sorted(range(sure.size), key=lambda cell: (-sure[cell], cell))
    cells = sorted(cell for cell in order[:most] if sure[cell] >= least)
    np.testing.assert_array_equal(codec.chosen(sent), cells)
    channels, rest = len(sent.values), np.setdiff1d(np.arange(sure.size), cells)
    scales = 4 * channels if number == "int8" else 0
    numbers = min(2 * len(cells), (sure.size + 7) // 8)  # one by one, or as bits
    assert len(payload) == 56 + numbers + len(cells) * (1 + BYTES[number] * channels) + scales
    assert got.sent is not None and np.flatnonzero(got.sent).tolist() == cells
    assert not got.values.reshape(channels, sure.size)[:, rest].any() and not got.confidence.ravel()[rest].any()
    kept = sent.values.reshape(channels, sure.size)[:, cells]
    back = got.values.reshape(channels, sure.size)[:, cells]
    assert (np.abs(back - kept) <= feature_error(kept, number)).all()
    assert np.abs(got.confidence.ravel()[cells] - sure[cells]).max(initial=0) <= 0.5 / 255 + 1e-6


@EVERY_NUMBER
@pytest.mark.parametrize(("count", "width"), [(0, 8), (1, 1), (30, 256), (3, 0)])
def test_queries_come_back_within_the_stated_errors(number: FeatureNumber, count: int, width: int) -> None:
    sent = replace(some_queries(count, width=width), space=0xDEADBEEF)
    payload = QueriesCodec(number).encode(sent)
    got = QueriesCodec().decode(payload)
    assert got.space == got[:1].space == 0xDEADBEEF
    scales = 4 * count if number == "int8" else 0
    assert len(payload) == 9 + 33 * count + scales + BYTES[number] * count * width
    assert (np.abs(got.feature - sent.feature) <= feature_error(sent.feature, number)).all()
    np.testing.assert_allclose(got.boxes.array, sent.boxes.array, rtol=2.0**-24)
    np.testing.assert_allclose(got.score, sent.score, rtol=2.0**-24)
    np.testing.assert_array_equal(got.label, sent.label)


@pytest.mark.parametrize("codec", [FeaturesCodec(), SparseFeaturesCodec(7)])
def test_a_request_and_the_networks_number_go_along(codec: Any) -> None:
    request = np.array([[0.0, 0.2, 1.0], [0.6, 0.4, 0.8]], np.float32)  # of blocks of 3 x 3 cells
    sent = replace(some_features((4, 6, 9)), request=request, space=0xDEADBEEF)
    plain = len(codec.encode(replace(sent, request=None)))
    payload = codec.encode(sent)
    assert len(payload) == plain + request.size
    got = codec.decode(payload)
    assert got.space == 0xDEADBEEF and got.request is not None and got.request_block == 3
    np.testing.assert_allclose(got.request, request, atol=0.5 / 255 + 1e-6)
    for cut in range(len(payload)):
        with pytest.raises(CodecError):
            codec.decode(payload[:cut])
    with pytest.raises(CodecError, match="blocks of 4 x 4 do not divide 6 x 9 cells"):
        codec.decode(payload[:5] + b"\x04" + payload[6:])


def test_cells_of_large_maps_have_numbers_of_four_bytes() -> None:
    confidence = np.zeros((300, 300), np.float32)
    confidence[299, 297:], confidence[0, 0] = 0.5, 1.0
    sent = feature_map(np.arange(90_000.0).reshape(1, 300, 300) / 4, confidence)
    payload = SparseFeaturesCodec(4, number="float32").encode(sent)
    assert len(payload) == 56 + 4 * (4 + 1 + 4)
    got = SparseFeaturesCodec().decode(payload)
    assert got.values[0, 299, 299] == 89_999 / 4 and got.sent is not None and got.sent.sum() == 4


def test_what_a_sender_does_not_know_it_does_not_send() -> None:
    known = np.zeros((6, 9), np.bool_)
    known[2, 3:5] = True
    sent = replace(some_features((4, 6, 9)), sent=known)
    got = SparseFeaturesCodec().decode(SparseFeaturesCodec().encode(sent))
    np.testing.assert_array_equal(got.sent, known)


def spoilt(values: float) -> FeatureMap:
    features = some_features()
    return replace(features, values=np.where(features.values == features.values[1, 2, 3], values, features.values))


def queries_with(**changes: Any) -> InstanceQueries:
    return replace(some_queries(2, width=4), **changes)


@pytest.mark.parametrize(
    ("codec", "content", "match"),
    [
        (FeaturesCodec("float32"), spoilt(np.nan), "features must be finite"),
        (SparseFeaturesCodec(number="int8"), spoilt(np.inf), "features must be finite"),
        (FeaturesCodec("float16"), spoilt(1e6), "features beyond 65504 are too large for float16"),
        (FeaturesCodec(), feature_map(np.zeros((1, 1025, 1024)), None), r"no message has features \(1, 1025, 1024\)"),
        (FeaturesCodec(), feature_map(np.zeros((70_000, 1, 1))), "at most 65535"),
        (FeaturesCodec(), feature_map(np.zeros((1, 1, 1)), np.full((1, 1), 1.5)), r"confidences .* in \[0, 1\]"),
        (FeaturesCodec(), replace(some_features(), request=np.full((2, 3), -0.1)), r"requests .* in \[0, 1\]"),
        (SparseFeaturesCodec(), feature_map(np.zeros((1, 2, 2))), "only of features that have confidences"),
        (QueriesCodec(), queries_with(score=[0.5, np.nan]), "query 1 cannot be sent"),
        (QueriesCodec(), queries_with(label=[9, 0]), "query 0 cannot be sent"),
        (QueriesCodec(), queries_with(feature=np.zeros((2, 70_000))), "got 2 x 70000"),
    ],
)
def test_what_cannot_be_sent_is_refused(codec: Any, content: Any, match: str) -> None:
    with pytest.raises(CodecError, match=match):
        codec.encode(content)


def test_bad_settings_are_refused() -> None:
    for codec in (FeaturesCodec, SparseFeaturesCodec, QueriesCodec):
        with pytest.raises(UnknownNameError, match=r"unknown number 'int4'.*float16, float32, int8"):
            codec(number="int4")
    with pytest.raises(InvalidValueError, match="most_cells must be an integer >= 0"):
        SparseFeaturesCodec(-1)
    with pytest.raises(InvalidValueError, match=r"least_confidence must be in \[0, 1\]"):
        SparseFeaturesCodec(5, 1.5)
