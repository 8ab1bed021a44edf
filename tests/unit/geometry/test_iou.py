"""The overlap kernels against a polygon library, on random and on awkward boxes."""

from __future__ import annotations

import numpy as np
import pytest
from shapely.geometry import Polygon

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_3d, giou_bev, iou_3d, iou_3d_and_bev, iou_bev

KERNELS = (iou_3d, giou_3d, iou_bev, giou_bev)
CAR = [0.0, 0, 0, 4, 2, 1.5, 0]


def reference(a: np.ndarray, b: np.ndarray) -> dict[str, np.ndarray]:
    """All four overlaps, pair by pair, by shapely."""
    out = {name: np.zeros((len(a), len(b))) for name in ("iou_3d", "giou_3d", "iou_bev", "giou_bev")}
    for i, p in enumerate(a):
        for j, q in enumerate(b):
            first, second = (Polygon(Boxes3D.from_array(x[None]).corners[0, :4, :2]) for x in (p, q))
            inter, hull = first.intersection(second).area, first.union(second).convex_hull.area
            union = first.area + second.area - inter
            low, high = (np.array([x[2] + side * x[5] / 2 for x in (p, q)]) for side in (-1, 1))
            shared = inter * max(0.0, high.min() - low.max())
            volume = first.area * p[5] + second.area * q[5] - shared
            enclosing = hull * (high.max() - low.min())
            out["iou_bev"][i, j] = inter / union
            out["giou_bev"][i, j] = inter / union - (hull - union) / hull
            out["iou_3d"][i, j] = shared / volume
            out["giou_3d"][i, j] = shared / volume - (enclosing - volume) / enclosing
    return out


def random_boxes(count: int, seed: int, spread_m: float = 6.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [
            rng.uniform(-spread_m, spread_m, (count, 2)),
            rng.uniform(-1, 1, count),
            rng.uniform(0.3, 9, (count, 3)),
            rng.uniform(-7, 7, count),
        ]
    )


@pytest.mark.parametrize("kernel", KERNELS)
def test_random_boxes_agree_with_shapely(kernel) -> None:  # type: ignore[no-untyped-def]
    a, b = random_boxes(25, 0), random_boxes(25, 1)
    np.testing.assert_allclose(kernel(a, b), reference(a, b)[kernel.__name__], atol=1e-9)


AWKWARD = {
    "identical": (CAR, CAR),
    "identical, turned half round": (CAR, [0, 0, 0, 4, 2, 1.5, np.pi]),
    "same, quarter turn": (CAR, [0, 0, 0, 2, 4, 1.5, np.pi / 2]),
    "touching along a side": (CAR, [0, 2, 0, 4, 2, 1.5, 0]),
    "touching at a corner": (CAR, [4, 2, 0, 4, 2, 1.5, 0]),
    "contained": (CAR, [0.2, 0.1, 0, 1, 0.5, 0.5, 0.7]),
    "sharing a side from within": (CAR, [1, 0, 0, 2, 2, 1.5, 0]),
    "tiny in large": (CAR, [1, 0.5, 0, 1e-4, 1e-4, 1e-4, 0.3]),
    "apart": (CAR, [50, 50, 0, 4, 2, 1.5, 0.4]),
    "one above the other": (CAR, [0, 0, 10, 4, 2, 1.5, 0.4]),
    "standing on the other": (CAR, [0, 0, 1.5, 4, 2, 1.5, 0]),
    "a cross": (CAR, [0, 0, 0, 4, 2, 1.5, np.pi / 2]),
    "eighth turn": (CAR, [0, 0, 0, 4, 2, 1.5, np.pi / 4]),
    "nearly parallel": (CAR, [0, 1e-9, 0, 4, 2, 1.5, 1e-12]),
    "a corner against a side": (CAR, [2 + np.sqrt(2), 0, 0, 2, 2, 1.5, np.pi / 4]),
    "both tiny": ([0, 0, 0, 1e-3, 1e-3, 1e-3, 0.2], [5e-4, 2e-4, 0, 1e-3, 2e-3, 1e-3, 1.0]),
    "tiny and far": ([0, 0, 0, 1e-3, 1e-3, 1e-3, 0.2], [900, -700, 5, 1e-3, 1e-3, 1e-3, 1.0]),
    "long and thin": ([0, 0, 0, 30, 1e-3, 2, 0.3], [3, 1, 0, 30, 1e-3, 2, -1.2]),
}


@pytest.mark.parametrize(("first", "second"), AWKWARD.values(), ids=AWKWARD)
def test_awkward_boxes_agree_with_shapely(first: list[float], second: list[float]) -> None:
    a, b = np.array([first], dtype=float), np.array([second], dtype=float)
    for kernel in KERNELS:
        expected = reference(a, b)[kernel.__name__]
        np.testing.assert_allclose(kernel(a, b), expected, atol=1e-9, err_msg=kernel.__name__)
        np.testing.assert_allclose(kernel(b, a), expected, atol=1e-9, err_msg=kernel.__name__)


@pytest.mark.parametrize("turn", [np.pi / 2, np.pi / 4])
def test_boxes_on_a_grid_agree_with_shapely(turn: float) -> None:
    """Whole metres and whole turns: sides and corners touch, coincide and contain each other all the time."""
    rng = np.random.default_rng(4)
    a, b = (np.column_stack([rng.integers(-3, 4, (25, 3)), rng.integers(1, 5, (25, 3))]) for _ in range(2))
    a, b = (np.column_stack([rows, rng.integers(-8, 9, 25) * turn]) for rows in (a, b))
    expected = reference(a, b)
    for kernel in KERNELS:
        np.testing.assert_allclose(kernel(a, b), expected[kernel.__name__], atol=1e-9, err_msg=kernel.__name__)


@pytest.mark.parametrize("kernel", KERNELS)
def test_far_from_the_origin_nothing_changes(kernel) -> None:  # type: ignore[no-untyped-def]
    a, b = random_boxes(20, 2), random_boxes(20, 3)
    shift = np.array([12_345_678.0, -54_321_000.0, 4_000, 0, 0, 0, 0])
    np.testing.assert_allclose(kernel(a + shift, b + shift), kernel(a, b), atol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_box_overlaps_itself_by_exactly_one(kernel) -> None:  # type: ignore[no-untyped-def]
    boxes = random_boxes(50, 5)
    assert (np.diag(kernel(boxes, boxes)) == 1).all()


def test_a_box_that_is_not_a_number_overlaps_nothing() -> None:
    for column in range(7):
        broken = np.array([CAR])
        broken[0, column] = np.nan
        for kernel in (iou_3d, giou_3d):
            assert not kernel(broken, np.array([CAR]))[0, 0] > 0
            assert not kernel(np.array([CAR]), broken)[0, 0] > 0


@pytest.mark.parametrize("seed", range(5))
def test_both_at_once_are_the_same_to_the_bit(seed: int) -> None:
    first, second = random_boxes(60, seed), random_boxes(80, seed + 100)
    second[:60:3] = first[::3]
    second[1, 0], second[4, 3:6], first[2, 6] = np.nan, 0.0, np.inf
    in_space, from_above = iou_3d_and_bev(first, second)
    assert (from_above > 0).any() and (in_space < from_above).any()
    np.testing.assert_array_equal(in_space, iou_3d(first, second))
    np.testing.assert_array_equal(from_above, iou_bev(first, second))
    assert [each.shape for each in iou_3d_and_bev(first[:0], second)] == [(0, 80)] * 2


def test_no_boxes_give_empty_matrices() -> None:
    assert iou_3d(np.zeros((0, 7)), random_boxes(3, 0)).shape == (0, 3)
    assert giou_3d(random_boxes(3, 0), np.zeros((0, 7))).shape == (3, 0)


def test_boxes_without_volume_overlap_nothing() -> None:
    flat = np.array([[0.0, 0, 0, 0, 0, 0, 0]])
    for kernel in KERNELS:
        assert np.isfinite(kernel(flat, flat)).all()
        assert kernel(flat, np.array([CAR]))[0, 0] <= 0


def test_wrong_shape_is_named() -> None:
    with pytest.raises(InvalidValueError, match=r"second boxes must have shape \(N, 7\), got \(1, 6\)"):
        iou_3d(np.zeros((1, 7)), np.zeros((1, 6)))
