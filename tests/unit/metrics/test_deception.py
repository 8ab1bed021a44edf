"""Counts of believed lies, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.metrics.deception import DECEPTION
from coopsim.metrics.deception_log import DeceptionLog
from coopsim.metrics.log_pool import LogPool
from coopsim.types import GroundTruth, Tracks
from coopsim.types.lies import Lie

SHIFT = SE3.from_xyz_yaw(np.array([100.0, 50.0, 0.0]), np.pi / 2)


def boxes(*places: tuple[float, float]) -> Boxes3D:
    return Boxes3D.from_array([[x, y, 0.8, 4.0, 2.0, 1.6, 0.0] for x, y in places] or np.zeros((0, 7)))


def tracks(*places: tuple[float, float]) -> Tracks:
    count = len(places)
    none = np.zeros(count, np.int64)
    return Tracks(np.arange(count), boxes(*places), np.zeros((count, 2)), np.ones(count), none)


def truth(*places: tuple[float, float]) -> GroundTruth:
    return GroundTruth(np.arange(len(places)) + 1, boxes(*places), np.zeros(len(places), np.int64))


def lie(claimed: Boxes3D, denied: Boxes3D) -> Lie:
    """Return a lie about places in the receiver's base frame, which is at SHIFT."""
    ids = np.arange(len(claimed))
    return Lie(0, "cav_1", "ghost", ("cav_1",), ids, claimed.transform(SHIFT), denied.transform(SHIFT))


def values(log: DeceptionLog) -> dict[str, float | None]:
    pool = LogPool([], records={"deceptions": [log]})
    return {name: metric.value(pool) for name, metric in DECEPTION.items()}


REGION: Floats = np.array([50.0, 40.0])


def test_a_ghost_is_believed_while_a_track_is_on_it() -> None:
    log = DeceptionLog()
    for places in ((), (), ((15.5, 1.0),), ((15.0, 0.0),), (), ((15.0, 0.0),)):
        log.append([lie(boxes((15, 0)), boxes())], SHIFT, truth(), tracks(*places), REGION)
    found = values(log)
    assert found["ghosts_believed"] == 100
    assert found["ghost_frames"] == pytest.approx(50)
    assert (found["ghost_delay"], found["ghost_life"]) == (2, 2)
    assert math.isnan(found["denied_lost"] or 0)


def test_a_claim_beside_a_true_object_or_outside_of_the_region_does_not_count() -> None:
    log = DeceptionLog()
    log.append([lie(boxes((15, 0), (60, 0)), boxes())], SHIFT, truth((15, 1)), tracks((15, 1), (60, 0)), REGION)
    assert log.ghosts == {}


def test_a_denied_object_is_lost_where_no_track_is_on_it() -> None:
    log = DeceptionLog()
    around = truth((10, 0), (20, 0), (30, 0))
    log.append([lie(boxes(), boxes((10, 0.5), (20, 0.5)))], SHIFT, around, tracks((20, 0)), REGION)
    assert values(log)["denied_lost"] == 50


def test_without_a_lie_there_is_no_value() -> None:
    assert all(metric.value(LogPool([])) is None for metric in DECEPTION.values())
