"""The log of a drive gives back what was put in, in the world frame, whatever came and went."""

import math

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics import DriveFrame, DriveLog, Evaluator, LogPool, summarize
from coopsim.types import GroundTruth, Tracks
from coopsim.types.driving import CarState, Route

ROUTE = Route(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), 1.0, np.array([13.0, 12.0, 11.0]), np.zeros(3, np.int64))


def frame(time_ns: int, pose: tuple[float, float, float], **others: object) -> DriveFrame:
    car = CarState(10.0, -1.0, 4.5, 1.9, bool(others.pop("crashed", False)), ROUTE)
    defaults = {"truth": GroundTruth.empty(), "tracks": Tracks.empty(), **others}
    return DriveFrame(time_ns, np.array(pose), car, **defaults)  # type: ignore[arg-type]


def person(identity: int, x: float, y: float, vx: float, vy: float) -> GroundTruth:
    box = Boxes3D.from_array([[x, y, 0.9, 0.5, 0.6, 1.8, 0.0]])
    return GroundTruth(np.array([identity]), box, np.array([7]), np.array([1]), np.array([[vx, vy]]))


def test_objects_are_placed_in_the_world_by_the_cars_true_pose() -> None:
    log = DriveLog()
    # The car looks north: ahead is +y, left is -x.
    log.append(frame(0, (100.0, 50.0, math.pi / 2), truth=person(4, 10.0, 2.0, 0.0, -1.5), conflict_ids=(4,)))
    drive = log.drive
    np.testing.assert_allclose(drive.boxes[0, 0], [98.0, 60.0, 0.5, 0.6, math.pi / 2], atol=1e-6)
    np.testing.assert_allclose(drive.velocity[0, 0], [1.5, 0.0], atol=1e-6)
    np.testing.assert_allclose(drive.velocity_m_s[0], [0.0, 10.0], atol=1e-6)
    np.testing.assert_allclose(drive.ways[0].points[2], [100.0, 52.0], atol=1e-6)
    assert drive.ways[0].speed_limit_m_s.tolist() == [13.0, 12.0, 11.0]
    assert drive.in_conflict.tolist() == [True]
    assert drive.seen_by.tolist() == [[1]]


def test_an_object_keeps_its_column_when_it_comes_and_goes() -> None:
    log = DriveLog()
    log.append(frame(0, (0.0, 0.0, 0.0), truth=person(9, 10.0, 0.0, 0.0, 0.0)))
    log.append(frame(100_000_000, (1.0, 0.0, 0.0), truth=person(3, 20.0, 0.0, 0.0, 0.0), command_m_s2=-8.0))
    log.append(frame(200_000_000, (2.0, 0.0, 0.0), crashed=True))
    drive = log.drive
    assert len(log) == len(drive) == 3
    assert drive.ids.tolist() == [3, 9]
    assert np.isnan(drive.boxes[:, :, 0]).tolist() == [[True, False], [False, True], [True, True]]
    assert drive.boxes[1, 0, 0] == pytest.approx(21.0)
    assert drive.crashed.tolist() == [False, False, True]
    assert np.isnan(drive.command_m_s2[0])
    assert drive.command_m_s2[1] == -8.0
    np.testing.assert_allclose(drive.time_s, [0.0, 0.1, 0.2])


def test_frames_must_be_in_order_and_objects_have_velocities() -> None:
    log = DriveLog()
    log.append(frame(5, (0.0, 0.0, 0.0)))
    with pytest.raises(InvalidValueError, match="later than the one before"):
        log.append(frame(5, (0.0, 0.0, 0.0)))
    one = person(1, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(InvalidValueError, match="velocities"):
        frame(9, (0.0, 0.0, 0.0), truth=GroundTruth(one.id, one.boxes, one.label))
    with pytest.raises(InvalidValueError, match="at least one frame"):
        _ = DriveLog().drive


def test_a_score_has_values_of_driving_where_there_are_drives() -> None:
    log = DriveLog()
    log.append(frame(0, (0.0, 0.0, 0.0)))
    assert LogPool.of([Evaluator().log], records={"drives": [log]}).records["drives"] == (log,)
    assert "crash" in summarize([Evaluator().log], records={"drives": [log]}).values
    assert "crash" not in summarize([Evaluator().log]).values
