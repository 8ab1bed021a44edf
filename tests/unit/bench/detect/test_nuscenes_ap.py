"""nuScenes' protocol by hand."""

from __future__ import annotations

import numpy as np
import pytest
from perceived_frames import detections, objects, values

from coopsim.types import ObjectClass


def test_distance_of_centres_decides() -> None:
    found = values("nuscenes", [(detections((1.5, 0.9)), objects(0))])
    assert [found[f"AP@{far}m car"] for far in ("0.5", "1", "2", "4")] == pytest.approx([0, 0, 1, 1])
    assert found["AP car"] == found["mAP"] == pytest.approx(0.5)  # other classes have no objects


def test_the_threshold_itself_is_too_far() -> None:
    assert values("nuscenes", [(detections((2.0, 0.9)), objects(0))])["AP@2m car"] == 0


def test_half_the_objects() -> None:
    # Precision 1 at the recalls 0.11 ... 0.50 of 0.11 ... 1.00.
    assert values("nuscenes", [(detections((0, 0.9)), objects(0, 30))])["AP@1m car"] == pytest.approx(40 / 90)


def test_precision_of_a_tenth_is_worth_nothing() -> None:
    false = [(float(x), 0.9) for x in range(5, 50, 5)]
    found = values("nuscenes", [(detections(*false, (0, 0.8)), objects(0))])  # nine false ones, then the hit
    assert found["AP@1m car"] == pytest.approx(0, abs=1e-12)


def test_precision_is_interpolated_and_not_raised() -> None:
    # False, hit, hit: precision 0, 1/2, 2/3 at recalls 0, 1/2, 1.
    found = values("nuscenes", [(detections((15, 0.9), (0, 0.8), (30, 0.7)), objects(0, 30))])
    recall = np.linspace(0.11, 1, 90)
    wanted = np.maximum(np.interp(recall, [0, 0.5, 1], [0, 1 / 2, 2 / 3]) - 0.1, 0).mean() / 0.9
    assert found["AP@1m car"] == pytest.approx(wanted)


def test_range_of_the_class() -> None:
    far = (detections((45, 0.9)), objects(45))
    assert values("nuscenes", [far])["AP@1m car"] == 1
    person = int(ObjectClass.PEDESTRIAN)
    assert np.isnan(values("nuscenes", [(detections((45, 0.9), label=person), objects(45, label=person))])["mAP"])
