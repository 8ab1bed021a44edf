"""OpenCOOD's protocol by hand."""

from __future__ import annotations

import numpy as np
import pytest
from perceived_frames import detections, objects, values

from coopsim.bench.detect.protocols import corners_within
from coopsim.metrics.average_precision import average_precision_of


def test_frames_are_ranked_one_after_another() -> None:
    # A false box of frame 1 (0.5) stands before the hit of frame 2 (0.9): hit, false, hit.
    first = (detections((0, 0.6), (60, 0.5)), objects(0))
    second = (detections((0, 0.9)), objects(0))
    assert values("opencood", [first, second])["APBEV@0.5"] == pytest.approx((1 + 2 / 3) / 2)
    assert values("coopsim", [first, second])["APBEV@0.5"] == 1


def test_it_is_the_average_precision_of_the_library_with_its_sort() -> None:
    rng = np.random.default_rng(0)
    frames = []
    for _ in range(12):
        places = np.arange(-60, 70, 12.0)
        scores = rng.uniform(0.25, 1.0, len(places))
        frames.append((detections(*zip(places + rng.normal(0, 1, len(places)), scores, strict=True)), objects(*places)))
    for least in (0.3, 0.5, 0.7):
        wanted = average_precision_of(*zip(*frames, strict=True), least, view="BEV", sort="frame")
        assert values("opencood", frames)[f"APBEV@{least:g}"] == pytest.approx(wanted)


def test_unsure_boxes_and_other_classes_are_left_out() -> None:
    assert values("opencood", [(detections((0, 0.2)), objects(0))])["APBEV@0.5"] == 0
    both = values("opencood", [(detections((0, 0.9), label=7), objects(0, label=7))])
    assert np.isnan(both["APBEV@0.5"])


def test_all_corners_must_be_within() -> None:
    box = np.array([[99.0, 0, 0, 4, 2, 1, 0], [97, 0, 0, 4, 2, 1, 0], [97.5, 0, 0, 4, 2, 1, np.pi / 2]])
    assert corners_within(box, (100.0, 40.0)).tolist() == [False, True, True]
