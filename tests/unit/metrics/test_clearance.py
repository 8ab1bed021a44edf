"""Gaps between bodies."""

from __future__ import annotations

import numpy as np

from coopsim.metrics.encounters import clearances


def test_gaps_do_not_depend_on_how_bodies_lie_in_memory() -> None:
    body, others = np.array([0.0, 0.0, 4.0, 2.0, 0.0]), np.array([[5.0, 0.0, 4.0, 2.0, 0.3], [0.0, 3.0, 4.0, 2.0, 0.0]])
    strided = np.stack([body, body], axis=1)[:, 0]  # as a film's columns are
    assert not strided.flags.c_contiguous
    assert clearances(strided, others).tolist() == clearances(body, others).tolist()
    assert clearances(body, others)[1] == 1.0
