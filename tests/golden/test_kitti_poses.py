"""People and cyclists of KITTI, whose car drives: how it moves comes from the recordings' poses."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import coopsim
from coopsim.agents.appearance import NIMBLE, DinoCoDTTracking
from coopsim.geometry.assignment import greedy, hungarian
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.motion.constant_velocity import ConstantVelocity


class WithoutTurning(DinoCoDTTracking):
    """The same with constant velocity for all classes."""

    def make_tracker(self) -> TrackersByClass:
        nimble = self._tracker(ConstantVelocity(), greedy)
        return TrackersByClass(self._tracker(ConstantVelocity(), hungarian), {NIMBLE: nimble})


@pytest.fixture
def kitti() -> Path:
    path = Path(os.environ.get("COOPSIM_DATA", "")) / "kitti"
    if "COOPSIM_DATA" not in os.environ or not (path / "poses").is_dir():
        pytest.skip("needs recordings: set COOPSIM_DATA to a folder that contains kitti with poses")
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "label", "expected"), [("Pedestrian", "pedestrian", 64.7), ("Cyclist", "bicycle", 51.5)]
)
def test_turning_is_no_worse_than_constant_velocity_with_poses(
    kitti: Path, kind: str, label: str, expected: float
) -> None:
    score = {
        policy: coopsim.evaluate_recordings(policy(), kitti, f"pointrcnn_{kind}", odometry="poses").count.classes[label]
        for policy in (DinoCoDTTracking, WithoutTurning)
    }
    turning, straight = (each["sAMOTA"] for each in score.values())
    assert turning == pytest.approx(expected, abs=0.1)
    assert turning > straight - 1.0
