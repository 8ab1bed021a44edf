"""Embeddings are directions; what has none is none."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.types.valid_detections import normalize_embeddings


def test_directions_of_anything_are_finite() -> None:
    unit, present = normalize_embeddings([[3, 4], [-3e300, 4e300], [5e-324, 0], [0, 0], [np.nan, 1], [np.inf, 1]])
    np.testing.assert_allclose(unit, [[0.6, 0.8], [-0.6, 0.8], [1, 0], [0, 0], [0, 0], [0, 0]], rtol=1e-6)
    assert present.tolist() == [True] * 3 + [False] * 3


def test_nothing_and_no_width() -> None:
    for shape in ((0, 3), (2, 0), (0, 0)):
        unit, present = normalize_embeddings(np.zeros(shape))
        assert unit.shape == shape and present.tolist() == [False] * shape[0]


def test_a_wrong_shape_is_named() -> None:
    with pytest.raises(InvalidValueError, match=r"embeddings must have shape \(2, N\), got \(1, 3\)"):
        normalize_embeddings(np.zeros((1, 3)), (2, None))
