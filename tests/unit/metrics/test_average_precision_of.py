"""Average precision of plain lists of boxes: by hand, and against a small second implementation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely.affinity import rotate, translate
from shapely.geometry import box

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics import average_precision_of
from coopsim.types import Detections, GroundTruth


def at(*x: float, z: float = 0.0) -> np.ndarray:
    """Cars at x, (N, 7)."""
    return np.array([[each, 0, z, 4, 2, 1.5, 0] for each in x]).reshape(-1, 7)


def test_a_false_box_costs_by_its_rank() -> None:
    truth = [at(0)]
    assert average_precision_of([(at(0, 50), [0.9, 0.5])], truth) == 1.0
    assert average_precision_of([(at(0, 50), [0.5, 0.9])], truth) == 0.5
    assert average_precision_of([(at(0, 0.1), [0.5, 0.9])], truth) == 1.0  # the second on the same object is false


def test_a_miss_costs_its_share_of_recall() -> None:
    assert average_precision_of([(at(0), [0.5])], [at(0, 30)]) == 0.5
    assert average_precision_of([(at(), [])], [at(0)]) == 0.0
    assert average_precision_of([(at(0), [0.5])], [at()]) == 0.0
    assert average_precision_of([], []) == 0.0


def test_ranking_is_over_all_frames_unless_each_frame_is_asked_for() -> None:
    """A false box with a low score in the first frame stands before the second frame's matches only by frame."""
    detections = [(at(0, 50), [0.9, 0.1]), (at(0), [0.8])]
    truth = [at(0), at(0)]
    assert average_precision_of(detections, truth) == 1.0
    assert average_precision_of(detections, truth, sort="frame") == pytest.approx((1 + 2 / 3) / 2)


@pytest.mark.parametrize("view", ["3D", "BEV"])
def test_equal_scores_are_one_step_whichever_is_listed_first(view: Any) -> None:
    hit_first, miss_first = (at(0, 50), [0.5, 0.5]), (at(50, 0), [0.5, 0.5])
    for frames in ([hit_first] * 2, [miss_first] * 2, [hit_first, miss_first]):
        assert average_precision_of(frames, [at(0)] * 2, view=view) == 0.5
    # Of two boxes that are equally sure the one at 0.2, which fits better, has the first choice: the object at 0, the
    # only one that the box at -0.5 is on.
    for boxes in (at(-0.5, 0.2), at(0.2, -0.5)):
        assert average_precision_of([(boxes, [0.5, 0.5])], [at(0, 1)], 0.6, view=view) == 0.25


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_the_order_of_boxes_and_frames_does_not_matter(seed: int, levels: int) -> None:
    rng = np.random.default_rng(seed)

    def crowd(count: int) -> np.ndarray:
        return at(*rng.uniform(0, 12, count)) + rng.normal(0, 0.1, (count, 7)) * [1, 1, 1, 0, 0, 0, 1]

    frames = [(crowd(count), crowd(rng.integers(0, 6))) for count in rng.integers(1, 6, 6)]
    listed = [((boxes, rng.integers(1, levels + 1, len(boxes)) / levels), truth) for boxes, truth in frames]
    mixed = []
    for (boxes, scores), truth in rng.permutation(np.array(listed, dtype=object)):
        order = rng.permutation(len(boxes))
        mixed.append(((boxes[order], scores[order]), rng.permutation(truth)))
    for iou in (0.3, 0.7):
        values = [average_precision_of(*zip(*each, strict=True), iou) for each in (listed, mixed)]  # type: ignore[misc]
        assert values[0] == pytest.approx(values[1], abs=1e-12)


def test_opencood_s_sort_keeps_the_order_of_the_list() -> None:
    for frame, expected in (((at(0, 50), [0.5, 0.5]), 1.0), ((at(50, 0), [0.5, 0.5]), 0.5)):
        assert average_precision_of([frame], [at(0)], sort="frame") == expected


def test_a_box_exactly_at_the_threshold_is_on_the_object() -> None:
    # 4 m by 2 m, of which 2 m are cut off: the intersection is half of the union, without a rounding error.
    half = np.array([[0, 0, 0, 2, 2, 1.5, 0]])
    for view in ("3D", "BEV"):
        assert average_precision_of([(half, [0.5])], [at(0)], 0.5, view=view) == 1.0  # type: ignore[arg-type]
        assert average_precision_of([(half, [0.5])], [at(0)], np.nextafter(0.5, 1), view=view) == 0.0  # type: ignore[arg-type]


def test_height_counts_in_3d_only() -> None:
    detections, truth = [(at(0, z=1.0), [0.5])], [at(0)]
    assert average_precision_of(detections, truth, 0.3) == 0.0
    assert average_precision_of(detections, truth, 0.7, view="BEV") == 1.0


def test_labels_must_agree_where_both_sides_have_them() -> None:
    labelled = [(at(0), [0.5], [0])]
    assert average_precision_of(labelled, [(at(0), [7])]) == 0.0
    assert average_precision_of(labelled, [(at(0), [0])]) == average_precision_of(labelled, [at(0)]) == 1.0


def test_the_library_s_own_types_are_taken() -> None:
    found = Detections(Boxes3D.from_array(at(0, 30)), np.array([0.9, 0.8]), np.array([0, 7]))
    there = GroundTruth(np.array([1, 2]), Boxes3D.from_array(at(0, 30)), np.array([0, 0]))
    assert average_precision_of([found], [there]) == 0.5
    assert average_precision_of([(found.boxes, found.score)], [there.boxes]) == 1.0


def corners(row: np.ndarray) -> Any:
    x, y, _, length, width, _, yaw = row
    return translate(rotate(box(-length / 2, -width / 2, length / 2, width / 2), yaw, use_radians=True), x, y)


def slow_iou(a: np.ndarray, b: np.ndarray, view: str) -> float:
    area = corners(a).intersection(corners(b)).area
    if view == "BEV":
        return float(area / (a[3] * a[4] + b[3] * b[4] - area))
    height = max(0.0, min(a[2] + a[5] / 2, b[2] + b[5] / 2) - max(a[2] - a[5] / 2, b[2] - b[5] / 2))
    return float(area * height / (np.prod(a[3:6]) + np.prod(b[3:6]) - area * height))


def slow_precision(frames: list[Any], iou: float, view: str, sort: str) -> float:
    """OpenCOOD's steps: match by score within a frame, rank, VOC2010's area by recall and precision."""
    ranked, total = [], 0
    for boxes, scores, truth in frames:
        total += len(truth)
        free = list(range(len(truth)))
        for j in np.argsort(-scores):
            overlaps = [slow_iou(truth[i], boxes[j], view) for i in free]
            hit = bool(free) and max(overlaps) >= iou
            if hit:
                free.pop(int(np.argmax(overlaps)))
            ranked.append((scores[j], hit))
    if sort == "pooled":
        ranked.sort(key=lambda each: -each[0])
    hits = np.cumsum([hit for _, hit in ranked])
    recall = [0, *(hits / total), 1]
    precision = [0, *(hits / np.arange(1, len(hits) + 1)), 0]
    for k in range(len(precision) - 2, -1, -1):
        precision[k] = max(precision[k], precision[k + 1])
    return float(sum((recall[k] - recall[k - 1]) * precision[k] for k in range(1, len(recall))))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("view", ["3D", "BEV"])
@pytest.mark.parametrize("sort", ["pooled", "frame"])
def test_crowds_against_a_second_implementation(seed: int, view: Any, sort: Any) -> None:
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(8):
        truth = at(*rng.uniform(0, 15, rng.integers(0, 6)))
        truth[:, 6] = rng.normal(0, 0.5, len(truth))
        found = np.concatenate([truth[rng.random(len(truth)) < 0.8], at(*rng.uniform(0, 15, rng.integers(0, 4)))])
        found += rng.normal(0, 0.15, found.shape)
        frames.append((found, rng.random(len(found)), truth))
    for iou in (0.3, 0.5, 0.7):
        value = average_precision_of(
            [(found, scores) for found, scores, _ in frames], [truth for *_, truth in frames], iou, view=view, sort=sort
        )
        assert value == pytest.approx(slow_precision(frames, iou, view, sort), abs=1e-9)


@pytest.mark.parametrize(
    ("detections", "truth", "options", "message"),
    [
        ([], [at(0)], {}, "one item per frame, got 0 and 1"),
        ([at(0)], [at(0)], {}, r"detections\[0\] must be Detections or a tuple \(boxes, scores\)"),
        ([(at(0), [1, 2])], [at(0)], {}, r"detections\[0\]: scores must have shape \(1,\)"),
        ([(at(0), [np.nan])], [at(0)], {}, "scores must be finite, got nan"),
        ([(at(0), [1])], [np.zeros((1, 6))], {}, r"truth\[0\] must have shape"),
        ([(at(0), [1])], [(at(0), [0], [1])], {}, r"truth\[0\] must be GroundTruth, boxes, or a tuple"),
        ([(at(0), [1])], [-at(0)], {}, "sizes must be > 0"),
        ([(at(0), [1])], [at(0)], {"iou": 0}, r"iou must be in \(0, 1\]"),
    ],
)
def test_what_does_not_fit_is_refused(detections: Any, truth: Any, options: Any, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        average_precision_of(detections, truth, **options)


def test_views_and_sorts_are_named() -> None:
    with pytest.raises(UnknownNameError, match="unknown view 'bev'"):
        average_precision_of([], [], view="bev")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="unknown sort 'global'"):
        average_precision_of([], [], sort="global")  # type: ignore[arg-type]
