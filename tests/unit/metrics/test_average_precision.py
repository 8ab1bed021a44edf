"""Average precision by hand, and against a slow reading of its definition."""

from __future__ import annotations

import numpy as np
import pytest
from test_clear import tracks, truth

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d, iou_bev
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.types import GroundTruth, Tracks

OVERLAPS = {"3D": iou_3d, "BEV": iou_bev}


def test_sure_false_boxes_cost_more_than_unsure_ones() -> None:
    found = {}
    for false_score in (0.1, 0.9):
        evaluator = Evaluator()
        for _ in range(4):
            evaluator.update(truth({1: 0}), tracks({9: 0, 8: 50}, scores={9: 0.5, 8: false_score}))
        found[false_score] = summarize([evaluator.log])["AP3D@0.5"]
    assert found == pytest.approx({0.1: 100, 0.9: 50})


def test_a_second_box_on_an_object_is_false() -> None:
    evaluator = Evaluator()
    evaluator.update(truth({1: 0, 2: 30}), tracks({9: 0, 8: 0.1, 7: 30}, scores={9: 0.9, 8: 0.8, 7: 0.7}))
    # Precision 1 at the first half of recall, 2/3 at the second.
    assert summarize([evaluator.log])["AP3D@0.7"] == pytest.approx(100 * (1 + 2 / 3) / 2)


def test_height_matters_in_3d_only() -> None:
    evaluator = Evaluator()
    low = tracks({9: 0})
    high = Boxes3D(np.add(low.boxes.center, [0, 0, 1.0]), low.boxes.size, low.boxes.yaw)
    evaluator.update(truth({1: 0}), Tracks(low.id, high, low.velocity, low.score, low.label))
    score = summarize([evaluator.log])
    assert (score["AP3D@0.3"], score["APBEV@0.7"]) == (0, 100)


def test_the_mean_is_over_classes() -> None:
    evaluator = Evaluator()
    for _ in range(9):
        evaluator.update(truth({1: 0}), tracks({9: 0}))
    evaluator.update(truth({2: 0}, label=7), tracks({}))
    score = summarize([evaluator.log])
    assert [score.classes[name]["AP3D@0.5"] for name in ("car", "pedestrian")] == [100, 0]
    assert score["mAP3D@0.5"] == 50 and score["AP3D@0.5"] == 90


def slow_precision(frames: list[tuple[GroundTruth, Tracks]], kind: str, threshold: float) -> float:
    """One box at a time; then the area, one step of recall at a time."""
    ranked: list[tuple[float, bool]] = []
    for objects, found in frames:
        overlap = OVERLAPS[kind](objects.boxes.array, found.boxes.array)
        free = set(range(len(objects)))
        for j in sorted(range(len(found)), key=lambda j: -found.score[j]):
            open_to = [i for i in free if overlap[i, j] >= threshold and objects.label[i] == found.label[j]]
            best = max(open_to, key=lambda i: overlap[i, j], default=None)
            free -= {best}
            ranked.append((found.score[j], best is not None))
    ranked.sort(reverse=True)
    total, area, hits, curve = sum(len(objects) for objects, _ in frames), 0.0, 0, []
    for k, (_, hit) in enumerate(ranked):
        hits += hit
        curve.append((hits / total, hits / (k + 1)))
    for level in range(1, total + 1):
        area += max((precision for recall, precision in curve if recall >= level / total - 1e-12), default=0) / total
    return 100 * area


@pytest.mark.parametrize("seed", range(6))
def test_crowds_as_the_definition_says(seed: int) -> None:
    rng = np.random.default_rng(seed)

    def some(count: int) -> tuple[Boxes3D, np.ndarray]:
        mean = np.column_stack([rng.uniform(0, 12, count), np.zeros((count, 2)), np.tile([4, 2, 1.5, 0], (count, 1))])
        return Boxes3D.from_array(mean + rng.normal(0, 0.1, mean.shape)), rng.choice([0, 7], count)

    frames = []
    for _ in range(15):
        there, found = rng.integers(0, 6, 2)
        boxes, label = some(found)
        reported = Tracks(np.arange(found), boxes, np.zeros((found, 2)), rng.random(found), label)
        frames.append((GroundTruth(np.arange(there), *some(there)), reported))
    logs = []
    for part in (frames[:6], frames[6:]):
        evaluator = Evaluator()
        for frame in part:
            evaluator.update(*frame)
        logs.append(evaluator.log)
    score = summarize(logs)
    for kind in OVERLAPS:
        for threshold in (0.3, 0.5, 0.7):
            expected = slow_precision(frames, kind, threshold)
            assert score[f"AP{kind}@{threshold}"] == pytest.approx(expected), (kind, threshold)
