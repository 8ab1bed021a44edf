"""Tests of formatted numbers."""

from __future__ import annotations

import math

import pytest

from coopsim.bench.results.statistics import Interval
from coopsim.bench.text.forms import difference_text


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        ((-50.0, -81.2, -0.3), "-50 (-81 to +0)"),
        ((0.4, -0.4, 1.0), "+0 (+0 to +1)"),
        ((2.0, math.nan, math.nan), "+2"),
    ],
)
def test_a_difference_has_no_negative_zero(interval: tuple[float, float, float], text: str) -> None:
    assert difference_text(Interval(*interval, 6), ".0f") == text
