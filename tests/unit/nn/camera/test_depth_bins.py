"""Bins of depth: what is laid into them comes out again."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.picture_net import DepthBins

BINS = DepthBins(2.0, 60.0, 16)


def test_bins_grow_linearly_from_the_nearest_to_the_farthest() -> None:
    middles = BINS.middles()
    assert (middles[0], middles[-1]) == (2.0, 60.0)
    growth = middles.diff().diff()
    torch.testing.assert_close(growth, growth.mean().expand(14), atol=1e-4, rtol=0)
    assert growth.mean() > 0


@given(st.floats(2.0, 60.0), st.integers(2, 80))
def test_shares_have_the_depth_as_their_mean(depth_m: float, count: int) -> None:
    bins = DepthBins(2.0, 60.0, count)
    shares = bins.shares(torch.tensor([depth_m]))[0]
    assert shares.shape == (count + 1,) and (shares >= 0).all()
    assert shares.sum() == pytest.approx(1.0) and shares[-1] == 0
    assert float(shares[:-1] @ bins.middles()) == pytest.approx(depth_m, rel=1e-4)
    filled = shares.nonzero()[:, 0]
    assert len(filled) <= 2 and filled[-1] - filled[0] <= 1  # neighbours


def test_what_is_too_near_is_in_the_first_bin_and_what_is_too_far_or_nothing_is_beyond() -> None:
    shares = BINS.shares(torch.tensor([[0.1, 2.0, 60.0], [60.01, 0.0, -1.0]]))
    assert shares.shape == (2, 17, 3)
    assert shares[0].argmax(0).tolist() == [0, 0, 15]
    assert shares[1].argmax(0).tolist() == [16, 16, 16]
    assert (shares.amax(1) == 1).all() and (shares.sum(1) == 1).all()


def test_shares_keep_the_places_of_cells() -> None:
    depth_m = torch.rand(3, 4, 5, generator=torch.Generator().manual_seed(0)) * 70
    shares = BINS.shares(depth_m)
    assert shares.shape == (3, 17, 4, 5)
    torch.testing.assert_close(shares[1, :, 2, 3], BINS.shares(depth_m[1, 2, 3].reshape(1))[0])


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"nearest_m": 0.0}, "nearest_m must be a finite number > 0"),
        ({"farthest_m": float("inf")}, "farthest_m must be a finite number > 0"),
        ({"nearest_m": 60.0}, "nearest_m must be less than farthest_m, got 60.0 and 60.0"),
        ({"count": 1}, r"depth_bins must be an integer in 2\.\.512, got 1"),
        ({"count": 3.0}, "depth_bins must be an integer"),
    ],
)
def test_bad_bins_are_refused(bad: dict[str, float], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        DepthBins(**bad)  # type: ignore[arg-type]
