"""coopsim's protocol by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from perceived_frames import PERSON, detections, objects, values

from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.average_precision import average_precision_of
from coopsim.types import Detections, ObjectClass

NOBODY, OTHERS, ME = 2, 1, 0


def test_half_found_without_false_boxes() -> None:
    found = values("coopsim", [(detections((0, 0.9)), objects(0, 30))])
    assert found["APBEV@0.5"] == found["AP3D@0.7"] == found["recall"] == pytest.approx(0.5)
    assert found["false_per_frame"] == 0


def test_all_frames_are_ranked_together() -> None:
    # Ranks: hit (0.9), false (0.8), hit (0.7): precision 1, then 2/3.
    early = (detections((0, 0.7), (60, 0.8)), objects(0))
    late = (detections((0, 0.9)), objects(0))
    assert values("coopsim", [early, late])["APBEV@0.5"] == pytest.approx((1 + 2 / 3) / 2)


def test_thresholds_are_of_the_overlap() -> None:
    found = values("coopsim", [(detections((1, 0.9)), objects(0))])  # IoU 3 / 5
    assert (found["APBEV@0.5"], found["APBEV@0.7"]) == (1, 0)


def test_height_matters_in_3d_only() -> None:
    low = objects(0)
    high = Detections(Boxes3D(np.add(low.boxes.center, [0, 0, 0.75]), low.boxes.size, low.boxes.yaw), [0.9], [0])
    found = values("coopsim", [(high, low)])  # 3D IoU 1/3
    assert (found["APBEV@0.7"], found["AP3D@0.3"], found["AP3D@0.5"]) == (1, 1, 0)


def test_objects_that_only_others_see() -> None:
    truth = objects(0, 30, 60, 80, seen_by=[ME, OTHERS, OTHERS, NOBODY], counts=[True, True, True, False])
    found = values("coopsim", [(detections((0, 0.9), (30, 0.8), (-50, 0.7), (80, 0.6)), truth)])
    assert found["recall others_only"] == pytest.approx(1 / 2)
    assert found["APBEV@0.5 others_only"] == pytest.approx(1 / 2)  # the hit on one's own is left out, not a hit
    assert found["recall own"] == found["APBEV@0.5 own"] == 1
    assert found["recall"] == pytest.approx(2 / 3)
    assert found["false_per_frame"] == 1  # the one on what nobody sees is neither right nor wrong


def test_a_false_box_counts_against_every_part_that_could_have_had_it() -> None:
    truth = objects(0, 45, seen_by=[ME, OTHERS])
    found = values("coopsim", [(detections((0, 0.8), (45, 0.7), (60, 0.9)), truth)])
    assert found["APBEV@0.5 own"] == found["APBEV@0.5 others_only"] == pytest.approx(0.5)
    assert found["APBEV@0.5 0-30m"] == found["APBEV@0.5 30-50m"] == 1
    assert math.isnan(found["APBEV@0.5 50-100m"])  # nothing was there


def test_an_unsure_false_box_is_not_counted_as_one() -> None:
    assert values("coopsim", [(detections((60, 0.3)), objects(0))])["false_per_frame"] == 0


def test_kinds() -> None:
    truck, cyclist = int(ObjectClass.TRUCK), int(ObjectClass.BICYCLE)
    person, child = int(ObjectClass.PEDESTRIAN), int(ObjectClass.CHILD)
    frames = [
        (detections((0, 0.9), label=truck), objects(0)),  # a car taken for a truck
        (detections((0, 0.9), label=child, size=PERSON), objects(0, label=person, size=PERSON)),
        (detections((0, 0.95), label=person, size=PERSON), objects(0, label=cyclist, size=PERSON)),
    ]
    found = values("coopsim", frames)
    assert found["APBEV@0.5"] == 1 and found["APBEV@0.5 car"] == 0
    assert found["APBEV@0.5 people"] == pytest.approx(0.5)  # the false one is surer
    assert found["APBEV@0.5 riders"] == 0 and found["APBEV@0.5 vulnerable"] == 1


def test_what_is_found_outside_the_region_is_not_looked_at() -> None:
    found = values("coopsim", [(detections((0, 0.5), (101, 0.9)), objects(0))])
    assert found["APBEV@0.5"] == 1 and found["false_per_frame"] == 0


def test_episodes_are_pooled() -> None:
    good, bad = [(detections((0, 0.9)), objects(0))], [(detections((60, 0.95)), objects(0))]
    assert values("coopsim", good, bad)["APBEV@0.5"] == pytest.approx(0.25)  # hit after the false one: 1/2 of 1/2


def test_it_is_the_average_precision_of_the_library() -> None:
    rng = np.random.default_rng(1)
    frames = []
    for _ in range(10):
        places = np.arange(-60, 70, 12.0)
        scores = rng.uniform(0, 1, len(places))
        frames.append((detections(*zip(places + rng.normal(0, 1, len(places)), scores, strict=True)), objects(*places)))
    for least in (0.3, 0.5, 0.7):
        wanted = average_precision_of(*zip(*frames, strict=True), least, view="3D")
        assert values("coopsim", frames)[f"AP3D@{least:g}"] == pytest.approx(wanted)


def test_nothing_found_and_nothing_there() -> None:
    assert values("coopsim", [(detections(), objects(0))])["APBEV@0.5"] == 0
    assert math.isnan(values("coopsim", [(detections((0, 0.9)), objects())])["APBEV@0.5"])


def test_backwards_is_the_share_of_sure_boxes_on_vehicles_that_point_to_the_rear() -> None:
    seen = detections((0, 0.9), (30, 0.8), (60, 0.2), (90, 0.9))  # the third is not sure, the last on nothing
    yaw = np.array([0.1, np.pi, np.pi, np.pi])
    turned = Detections(Boxes3D(seen.boxes.center, seen.boxes.size, yaw), seen.score, seen.label)
    assert values("coopsim", [(turned, objects(0, 30, 60))])["backwards"] == pytest.approx(1 / 2)
    assert math.isnan(values("coopsim", [(detections((0, 0.9)), objects(30))])["backwards"])
