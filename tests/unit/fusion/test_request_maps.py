"""Request maps: what is asked for, and where."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.fusion.request_maps import Request, request_map, selection_weight
from coopsim.types import BevGrid

GRID = BevGrid((-12.0, 12.0), (-6.0, 6.0), 1.0)


def sure_at(*cells: tuple[int, int]) -> np.ndarray:
    confidence = np.zeros(GRID.shape, np.float32)
    for cell in cells:
        confidence[cell] = 0.9
    return confidence


def test_blocks_with_something_sure_are_not_asked_for() -> None:
    values, grid = request_map(sure_at((5, 0)), GRID, factor=4)
    assert values.shape == grid.shape == (3, 6) and grid.cell_m == 4.0
    assert values[1, 0] == pytest.approx(0.1) and (np.delete(values.ravel(), 6) == 1).all()


def test_without_requests_confidence_decides() -> None:
    confidence = sure_at((1, 2), (7, 20))
    assert np.array_equal(selection_weight(confidence, GRID, []), confidence)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi])
def test_requests_are_read_where_the_receiver_means_them(yaw: float) -> None:
    """The receiver is sure of one place: the sender's cell there, and no other, loses its weight."""
    known = BevGrid((-20.0, 20.0), (-20.0, 20.0), 1.0)
    confidence = np.zeros(known.shape, np.float32)
    x, y = np.array([3.5, -2.5])  # the place in the sender's frame
    shift = np.array([2.0, 5.0])
    there = np.array([np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y]) + shift
    confidence[int(np.floor(there[1] + 20)), int(np.floor(there[0] + 20))] = 1.0
    values, grid = request_map(confidence, known, factor=1)
    weight = selection_weight(np.ones(GRID.shape, np.float32), GRID, [Request(values, grid, np.array([*shift, yaw]))])
    zero = np.argwhere(weight == 0)
    assert zero.tolist() == [[int(y + 5.5 + 0.5), int(x + 11.5 + 0.5)]]


def test_the_most_needy_receiver_counts_and_all_beyond_a_map_is_asked_for() -> None:
    small = BevGrid((-4.0, 4.0), (-4.0, 4.0), 4.0)
    nothing, half = np.zeros((2, 2), np.float32), np.full((2, 2), 0.5, np.float32)
    here = np.zeros(3)
    ones = np.ones(GRID.shape, np.float32)
    weight = selection_weight(ones, GRID, [Request(nothing, small, here)])
    assert weight[2:10, 8:16].max() == 0 and weight.sum() == ones.sum() - 64
    both = selection_weight(ones, GRID, [Request(nothing, small, here), Request(half, small, here)])
    assert (both[2:10, 8:16] == 0.5).all()


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="factor must divide"):
        request_map(sure_at(), GRID, factor=5)
