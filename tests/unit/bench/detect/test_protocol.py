"""What all protocols have in common."""

from __future__ import annotations

import math

import numpy as np
import pytest
from perceived_frames import detections, objects, overlaps, values

from coopsim.bench.detect.protocols import PROTOCOLS
from coopsim.errors import UnknownNameError

NAMES = PROTOCOLS.names()


def test_the_five_are_there() -> None:
    assert set(NAMES) >= {"coopsim", "opencood", "dair", "nuscenes", "v2x-real"}
    with pytest.raises(UnknownNameError, match="opencood"):
        PROTOCOLS.get("opencod")


@pytest.mark.parametrize("name", NAMES)
def test_every_row_has_the_average_precision_of_vehicles(name: str) -> None:
    frame = (detections((0, 0.9), (30, 0.8), (60, 0.7)), objects(0, 30, 60))
    found = values(name, [frame] * 5)
    assert 0.9 < found["APBEV@0.5"] <= 1
    assert all(math.isnan(value) or 0 <= value <= 1 for value in found.values())


@pytest.mark.parametrize("name", NAMES)
def test_episodes_without_boxes(name: str) -> None:
    empty = [(detections(), objects())] * 2
    assert set(values(name, empty)) == set(values(name, [(detections((0, 0.9)), objects(0))]))
    assert PROTOCOLS.get(name)().rankings(overlaps([]))["APBEV@0.5"].objects == 0


@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_boxes_in_a_frame_does_not_matter(name: str) -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(-45, 45, 15)
    boxes = list(zip((places + rng.normal(0, 1, 15)).tolist(), rng.uniform(0.2, 1, 15).tolist(), strict=True))
    one = values(name, [(detections(*boxes), objects(*places))])
    rng.shuffle(boxes)
    assert values(name, [(detections(*boxes), objects(*places))]) == pytest.approx(one, nan_ok=True)


def test_equal_scores_are_one_step_in_coopsim_s_and_as_listed_in_opencood_s() -> None:
    for places, listed in (((0, 50), 1.0), ((50, 0), 0.5)):
        frame = detections(*((place, 0.5) for place in places)), objects(0)
        assert values("coopsim", [frame, frame])["APBEV@0.5"] == 0.5
        assert values("opencood", [frame])["APBEV@0.5"] == listed
