"""DAIR-V2X's protocol by hand."""

from __future__ import annotations

import pytest
from perceived_frames import detections, objects, values


def test_the_first_hit_adds_nothing() -> None:
    found = values("dair", [(detections((0, 0.9), (30, 0.8), (60, 0.7), (90, 0.6)), objects(0, 30, 60, 90))])
    assert found["APBEV@0.5"] == found["AP3D@0.7"] == pytest.approx(3 / 4)


def test_after_a_false_box_every_hit_counts() -> None:
    # False, hit: recall goes from 0 to 1 at the second detection, with precision 1/2.
    assert values("dair", [(detections((60, 0.9), (0, 0.8)), objects(0))])["APBEV@0.5"] == pytest.approx(0.5)


def test_an_object_takes_the_nearest_box_and_not_the_surest() -> None:
    # The surest lies 1 m off (IoU 0.6), the other exactly. By score the surest has the object and the other is false.
    frame = (detections((1, 0.9), (0, 0.8)), objects(0, 60))
    assert values("dair", [frame])["APBEV@0.5"] == pytest.approx(0.25)  # false, hit: 1/2 of 1/2
    assert values("coopsim", [frame])["APBEV@0.5"] == pytest.approx(0.5)


def test_a_box_is_on_one_object() -> None:
    found = values("dair", [(detections((0, 0.9), (-60, 0.95)), objects(0, 1))])
    assert found["APBEV@0.5"] == pytest.approx(1 / 2 * 1 / 2)


def test_people_have_thresholds_of_their_own() -> None:
    names = set(values("dair", [(detections(), objects(0))]))
    assert {"APBEV@0.25 pedestrian", "AP3D@0.5 cyclist", "APBEV@0.7"} <= names
