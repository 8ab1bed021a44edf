"""Convex outlines: either way round, of whole millimetres, and nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.config.checked_entry import DataEntry
from coopsim.errors import InvalidValueError
from coopsim.world.custom.clearance import convex


def read(points: object) -> np.ndarray:
    entry = DataEntry(points, "outline", InvalidValueError)
    return convex(entry.polyline(3), entry)


@given(
    turn=st.floats(0.0, 6.3),
    count=st.integers(3, 40),
    size=st.floats(0.5, 60.0),
    clockwise=st.booleans(),
    halves=st.booleans(),
)
def test_polygons_in_whole_millimetres_are_convex(
    turn: float, count: int, size: float, clockwise: bool, halves: bool
) -> None:
    angle = turn + 2 * np.pi * np.arange(count) / count
    corners = size * np.column_stack([np.cos(angle), 0.3 * np.sin(angle)])
    if halves:  # corners of 180 degrees
        corners = np.stack([corners, (corners + np.roll(corners, -1, axis=0)) / 2], axis=1).reshape(-1, 2)
    outline = np.round(corners, 3)
    if np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).min() < 0.01:
        return
    got = read((outline[::-1] if clockwise else outline).tolist())
    x, y = got.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() > 0
    assert sorted(got.tolist()) == sorted(outline.tolist())


@pytest.mark.parametrize(
    ("outline", "message"),
    [
        ([[0, 0], [4, 0], [4, 4], [3.9, 2.0]], "must be convex: write another shape as several"),
        ([[0, 0], [4, 0], [2, 0.1], [4, 4]], "must be convex"),
        ([[0, 0], [4, 4], [4, 0], [0, 4]], "must be convex"),
        ([[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [4, 0], [4, 4], [0, 4]], "must be convex"),
        ([[0, 0], [4, 0], [8, 0]], "must be convex"),
        ([[0, 0], [4, 0], [4, 4], [0, 0]], "must have every corner once"),
        ([[0, 0], [4, 0]], "must be at least 3 points"),
    ],
)
def test_other_shapes_are_refused(outline: object, message: str) -> None:
    with pytest.raises(InvalidValueError, match=f"outline {message}"):
        read(outline)
