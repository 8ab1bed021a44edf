"""The area under the ROC of pairs."""

import numpy as np
import pytest

from coopsim.metrics.average_precision import separation


@pytest.mark.parametrize(
    ("similarity", "same", "expected"),
    [
        ([0.9, 0.8, 0.1], [True, True, False], 1.0),
        ([0.9, 0.8, 0.1], [False, False, True], 0.0),
        ([0.5, 0.5], [True, False], 0.5),
        ([0.9, 0.5, 0.7, 0.1], [True, True, False, False], 0.75),
    ],
)
def test_it_counts_the_pairs_in_the_right_order(similarity: list[float], same: list[bool], expected: float) -> None:
    assert separation(similarity, same) == pytest.approx(expected)


def test_it_is_the_share_of_ordered_pairs_of_pairs() -> None:
    rng = np.random.default_rng(0)
    similarity, same = np.round(rng.normal(size=200), 1), rng.random(200) < 0.3
    difference = similarity[same][:, None] - similarity[~same]
    assert separation(similarity, same) == pytest.approx(((difference > 0) + 0.5 * (difference == 0)).mean())


def test_one_kind_alone_says_nothing() -> None:
    assert np.isnan(separation([0.5], [True])) and np.isnan(separation([], []))
