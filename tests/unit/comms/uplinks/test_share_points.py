"""Points are thinned evenly, and those near the ground more than others."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.comms.uplinks.share_points import SharePoints
from coopsim.errors import InvalidValueError
from coopsim.types import Detections, Observation, Odometry, PoseEstimate, Sweep


def seen() -> Observation:
    """100 points at 0 m and 50 at 1 m, in turn."""
    z = np.tile([0.0, 0.0, 1.0], 50)
    points = np.column_stack([np.arange(150.0), np.zeros(150), z]).astype(np.float32)
    sweep = Sweep(points, np.zeros(150, np.float32), np.zeros(150, np.int64))
    return Observation(0, PoseEstimate(np.zeros(4)), Odometry(np.zeros(4)), Detections.empty(), {"top": sweep})


@pytest.mark.parametrize(
    ("keep", "keep_low", "low", "high"),
    [(1.0, None, 100, 50), (0.5, None, 50, 25), (1.0, 0.1, 10, 50), (0.5, 0.2, 20, 25), (1.0, 0.0, 0, 50)],
)
def test_so_many_points_are_sent(keep: float, keep_low: float | None, low: int, high: int) -> None:
    cloud = SharePoints(keep, keep_low=keep_low).content_of("cav_0", seen())
    assert [int((cloud.xyz[:, 2] == z).sum()) for z in (0, 1)] == [low, high]
    assert (np.diff(cloud.xyz[:, 0]) > 0).all()  # in the order of firing
    spread = cloud.xyz[cloud.xyz[:, 2] == 0, 0]
    if low:
        assert np.ptp(spread) > 100


def test_wrong_shares_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"keep must be in \(0, 1\]"):
        SharePoints(0.0)
    with pytest.raises(InvalidValueError, match=r"keep_low must be in \[0, 1\]"):
        SharePoints(keep_low=2.0)
