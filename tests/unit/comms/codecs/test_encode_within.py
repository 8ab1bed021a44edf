"""A budget leaves out the least useful part of content, no more than it must, and never goes over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from codec_samples import SAMPLES, some_detections, some_features, some_points, some_queries
from hypothesis import given, settings
from hypothesis import strategies as st

from coopsim.comms.codecs.codec import CODECS, decoder, make_codec
from coopsim.comms.codecs.feature_codec import FeaturesCodec, SparseFeaturesCodec
from coopsim.comms.codecs.point_codec import PointsCodec, VoxelsCodec
from coopsim.comms.codecs.query_codec import QueriesCodec
from coopsim.errors import CodecError, InvalidValueError, UnknownNameError

DIVISIBLE = [name for name in CODECS.names() if decoder(name).divisible]


def test_every_codec_but_the_dense_and_the_tracks_can_leave_something_out() -> None:
    assert set(CODECS.names()) - set(DIVISIBLE) == {"features", "tracks"}


@pytest.mark.parametrize("name", DIVISIBLE)
@settings(max_examples=25)
@given(count=st.integers(0, 30), budget_bytes=st.integers(1, 1500))
def test_no_payload_is_over_its_budget_unless_it_is_empty(name: str, count: int, budget_bytes: int) -> None:
    codec, content = decoder(name), SAMPLES[name](count)
    payload = codec.encode_within(content, budget_bytes)
    codec.decode(payload)
    if len(codec.encode(content)) <= budget_bytes:
        assert payload == codec.encode(content)
    empty = len(codec.encode_within(content, 1))
    assert len(payload) <= max(budget_bytes, empty)


@pytest.mark.parametrize("name", ["detections", "compact"])
def test_of_boxes_the_first_rows_are_sent(name: str) -> None:
    found, codec = some_detections(20), decoder(name)
    for count in range(21):
        size = len(codec.encode(found[:count]))
        assert codec.encode_within(found, size) == codec.encode(found[:count])
        if count < 20:
            assert codec.encode_within(found, len(codec.encode(found[: count + 1])) - 1) == codec.encode(found[:count])


def test_of_cpms_objects_the_first_are_sent() -> None:
    content, codec = SAMPLES["cpm"](9), decoder("cpm")
    first = replace(content, objects=content.objects[:4])
    assert codec.encode_within(content, len(codec.encode(first))) == codec.encode(first)


@pytest.mark.parametrize("number", ["float32", "float16", "int8"])
def test_of_features_the_surest_cells_are_sent(number: Any) -> None:
    content = some_features((5, 6, 7))
    codec = SparseFeaturesCodec(40, number=number)
    for count in (0, 1, 17, 39):
        exact = SparseFeaturesCodec(count, number=number).encode(content)
        assert codec.encode_within(content, len(exact)) == exact
        next_one = len(SparseFeaturesCodec(count + 1, number=number).encode(content))
        assert codec.encode_within(content, next_one - 1) == exact
    assert codec.encode_within(content, 10**6) == codec.encode(content)


@pytest.mark.parametrize("number", ["float32", "float16", "int8"])
def test_of_queries_the_surest_are_sent(number: Any) -> None:
    content, codec = some_queries(12), QueriesCodec(number)
    for count in (0, 1, 5, 11):
        rows = np.sort(np.argsort(-content.score, kind="stable")[:count])
        assert codec.encode_within(content, len(codec.encode(content[rows]))) == codec.encode(content[rows])


@pytest.mark.parametrize(("number", "size"), [("float32", 16), ("int16", 7)])
def test_of_points_evenly_spaced_ones_are_sent(number: Any, size: int) -> None:
    content, codec = some_points(1000), PointsCodec(number)
    for count in (0, 1, 10, 333, 999, 1000):
        got = codec.decode(codec.encode_within(content, 9 + size * count + size - 1))
        assert len(got) == count
        rows = [int(np.argmin(np.abs(content.xyz - point).sum(axis=1))) for point in got.xyz]
        assert len(set(rows)) == count
        assert np.diff([*rows, 1000]).max(initial=0) <= np.ceil(1000 / max(count, 1))


def test_of_voxels_larger_ones_are_sent() -> None:
    content, codec = some_points(5000), VoxelsCodec(0.1)
    sizes = []
    for budget_bytes in (10**6, 5000, 1000, 200, 37):
        payload = codec.encode_within(content, budget_bytes)
        assert len(payload) <= budget_bytes
        sizes.append(len(codec.decode(payload)))
    assert sizes[0] > sizes[1] > sizes[2] > sizes[3] > sizes[4] == 0
    assert np.abs(codec.decode(codec.encode_within(content, 1000)).xyz).max() > 0.5 * content.extent_m


def test_what_cannot_be_divided_says_so() -> None:
    content = some_features((4, 6, 9))
    whole = FeaturesCodec().encode(content)
    assert FeaturesCodec().encode_within(content, len(whole)) == whole
    with pytest.raises(CodecError, match=rf"FeaturesCodec cannot leave anything out of {len(whole)} bytes .* 100"):
        FeaturesCodec().encode_within(content, 100)


def test_a_codec_is_made_by_its_spec() -> None:
    name, codec = make_codec("sparse_features(most_cells=5, number=int8)", "features")
    content = some_features((4, 6, 9))
    assert name == "sparse_features"
    assert codec.encode(content) == SparseFeaturesCodec(5, number="int8").encode(content)


@pytest.mark.parametrize(
    ("spec", "error", "match"),
    [
        ("sparse_featurs", UnknownNameError, "unknown codec 'sparse_featurs'. Did you mean 'sparse_features'"),
        ("points", UnknownNameError, "Accepted: features, sparse_features"),
        ("features(", InvalidValueError, r"codec must be name or name\(parameter=value, ...\), got 'features\('"),
        ("features(numbr=int8)", UnknownNameError, "unknown parameter 'numbr' of codec 'features'.*'number'"),
        ("features(number=int4)", UnknownNameError, "unknown number 'int4'"),
        ("sparse_features(most_cells=-1)", InvalidValueError, "most_cells must be an integer >= 0, got -1"),
        (7, UnknownNameError, "unknown codec 7"),
    ],
)
def test_a_slip_in_a_spec_is_told(spec: object, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        make_codec(spec, "features")
