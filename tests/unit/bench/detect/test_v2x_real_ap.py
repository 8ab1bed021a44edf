"""V2X-Real's protocol by hand."""

from __future__ import annotations

import pytest
from perceived_frames import detections, objects, values

from coopsim.types import ObjectClass


def test_superclasses() -> None:
    van, truck = int(ObjectClass.VAN), int(ObjectClass.TRUCK)
    frames = [
        (detections((0, 0.9), label=van), objects(0, label=truck)),  # both are of the superclass Truck
        (detections((0, 0.9), label=van), objects(0)),  # a car taken for a van
    ]
    found = values("v2x-real", frames)
    assert found["APBEV@0.5 Truck"] == 1 and found["APBEV@0.5 Vehicle"] == 0
    assert found["mAPBEV@0.5"] == pytest.approx(0.5)  # no people
    assert found["APBEV@0.5"] == 1
