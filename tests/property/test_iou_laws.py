"""What holds for any two boxes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coopsim.geometry.iou import giou_3d, giou_bev, iou_3d, iou_bev

KERNELS = (iou_3d, giou_3d, iou_bev, giou_bev)

metres = st.floats(-20, 20)
size = st.floats(0.01, 15)
box = st.tuples(metres, metres, metres, size, size, size, st.floats(-10, 10)).map(lambda row: np.array([row]))


@given(box, box)
def test_symmetric_bounded_and_ordered(a: np.ndarray, b: np.ndarray) -> None:
    for iou, giou in ((iou_3d, giou_3d), (iou_bev, giou_bev)):
        plain, generalized = iou(a, b)[0, 0], giou(a, b)[0, 0]
        np.testing.assert_allclose(plain, iou(b, a)[0, 0], atol=1e-7)
        np.testing.assert_allclose(generalized, giou(b, a)[0, 0], atol=1e-7)
        assert 0 <= plain <= 1
        assert -1 < generalized <= plain + 1e-12
    assert iou_3d(a, b)[0, 0] <= iou_bev(a, b)[0, 0] + 1e-7


@given(box)
def test_a_box_is_itself(a: np.ndarray) -> None:
    for kernel in KERNELS:
        np.testing.assert_allclose(kernel(a, a), 1.0, atol=1e-7)


@given(box, box, st.floats(-7, 7), metres, metres)
def test_moving_and_turning_the_world_changes_nothing(
    a: np.ndarray, b: np.ndarray, turn: float, x: float, y: float
) -> None:
    def moved(row: np.ndarray) -> np.ndarray:
        cos, sin = np.cos(turn), np.sin(turn)
        out = row.copy()
        out[:, 0] = row[:, 0] * cos - row[:, 1] * sin + x
        out[:, 1] = row[:, 0] * sin + row[:, 1] * cos + y
        out[:, 6] += turn
        return out

    for kernel in KERNELS:
        np.testing.assert_allclose(kernel(moved(a), moved(b)), kernel(a, b), atol=1e-6)
