"""Labels beside markers: whatever the points are, none lies on another one or on a marker while there is room."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coopsim.bench.paper.trade_off_plot import lay_out
from coopsim.geometry.se3 import Floats

AREA = np.array([0.0, 0.0, 500.0, 300.0])
NONE = np.zeros((0, 4))


def boxes(places: Floats, sizes: Floats) -> Floats:
    low = places - np.column_stack([np.zeros(len(places)), sizes[:, 1] / 2])
    return np.column_stack([low, low + sizes])


def overlap(one: Floats, other: Floats) -> bool:
    return bool(one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3])


def require_free(points: Floats, sizes: Floats) -> Floats:
    taken = np.column_stack([points - 3, points + 3])
    placed = lay_out(points, sizes, taken, NONE, AREA)
    labels = boxes(placed, sizes)
    assert not any(overlap(a, b) for a, b in itertools.combinations(labels, 2))
    assert not any(overlap(a, b) for a in labels for b in taken)
    assert (labels[:, :2] >= AREA[:2] - 1e-9).all() and (labels[:, 2:] <= AREA[2:] + 1e-9).all()
    return placed


def test_a_lone_label_is_to_the_right_of_its_marker_or_to_its_left_at_the_edge() -> None:
    sizes = np.array([[60.0, 9.0]])
    (inside,) = require_free(np.array([[100.0, 100.0]]), sizes)
    assert inside[1] == 100.0 and 100.0 < inside[0] < 110.0
    (edge,) = require_free(np.array([[480.0, 100.0]]), sizes)
    assert edge[1] == 100.0 and edge[0] + 60.0 < 480.0


@given(st.lists(st.tuples(st.sampled_from([100.0, 102.0, 350.0]), st.floats(100, 200)), min_size=1, max_size=16))
def test_a_column_of_markers_has_labels_apart(found: list[tuple[float, float]]) -> None:
    """As where a dozen methods send the same bytes and are nearly as good."""
    require_free(np.array(found), np.tile([60.0, 9.0], (len(found), 1)))


def test_without_room_there_is_a_place_still() -> None:
    points, sizes = np.tile([250.0, 150.0], (3, 1)), np.tile([900.0, 9.0], (3, 1))
    assert np.isfinite(lay_out(points, sizes, NONE, NONE, AREA)).all()


def test_a_label_keeps_off_a_whisker_if_it_need_not_go_far() -> None:
    point, size = np.array([[100.0, 100.0]]), np.array([[60.0, 9.0]])
    for low, level in ((90.0, False), (-1e3, True)):
        whisker = np.array([[130.0, low, 132.0, 104.0 if low > 0 else 1e3]])
        left = np.array([[0.0, 0.0, 95.0, 300.0]])
        (placed,) = lay_out(point, size, left, whisker, AREA)
        assert (placed[1] == 100.0) == level and abs(placed[1] - 100.0) < 40.0
