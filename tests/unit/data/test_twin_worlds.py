"""Twins of recordings: whose labels are whose, errors of the second car's pose, and lines that are read back."""

from pathlib import Path

import numpy as np
import pytest
from measure_twin import detection_lines, draw_pose_errors, placed, shifted, write_lines
from twin_worlds import Labels

from coopsim.data.kitti import read_detections
from coopsim.data.recording_set import Recording
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, GroundTruth


def boxes(*places: tuple[float, float]) -> Boxes3D:
    """Return cars that look along x."""
    return Boxes3D.from_array([[x, y, 0.8, 4.5, 1.9, 1.6, 0.0] for x, y in places])


def test_labels_of_both_cars_are_told_apart() -> None:
    there = boxes((20.0, 0.0), (21.0, 0.5), (0.4, 0.2), (40.0, 3.0))
    truth = GroundTruth(np.array([1, 101, 102, 103]), there, np.zeros(4, np.int64))
    labels = Labels.read(Recording(1, [truth], {}))
    assert labels.own.tolist() == [False, False, True, False], "the first car is at the origin"
    assert labels.late.tolist() == [False, True, True, True]
    assert labels.of.tolist() == [0, 0, 2, 3], "both cars labelled the object ahead"
    assert labels.objects.tolist() == [0, 3]


def test_an_error_of_the_pose_moves_boxes_about_the_car_that_saw_them() -> None:
    second = np.array([50.0, 4.0, 0.3])
    seen = placed(boxes((10.0, 0.0)), second)
    off = shifted(seen, second, np.array([0.5, -0.2, 0.01]))
    expected = placed(boxes((10.0, 0.0)), second + np.array([0.5, -0.2, 0.01]))
    assert off.array == pytest.approx(expected.array)
    assert shifted(seen, second, np.zeros(3)).array == pytest.approx(seen.array)


def test_drawn_errors_have_the_fitted_spread_and_last() -> None:
    errors = {"mean": [0.1, 0, 0], "between": [0, 0, 0], "within": [0.4, 0.2, 0.002], "kept": [0.9, 0.9, 0.9]}
    drawn = draw_pose_errors(errors, 20_000, 0, "0000")
    assert drawn.mean(axis=0) == pytest.approx([0.1, 0.0, 0.0], abs=0.05)
    assert drawn.std(axis=0) == pytest.approx([0.4, 0.2, 0.002], rel=0.1)
    assert np.corrcoef(drawn[1:, 0], drawn[:-1, 0])[0, 1] == pytest.approx(0.9, abs=0.02)
    assert (drawn == draw_pose_errors(errors, 20_000, 0, "0000")).all()


def test_detections_are_read_back_and_cut_to_the_region(tmp_path: Path) -> None:
    there = boxes((10.0, 2.0), (120.0, 0.0))
    lines = detection_lines(7, Detections(there, np.array([0.75, 0.5]), np.zeros(2, np.int64)))
    write_lines(tmp_path / "ego" / "0000.txt", lines)
    frame, found, score, _ = read_detections(tmp_path / "ego" / "0000.txt", "v2v4real")
    assert frame.tolist() == [7] and score.tolist() == [0.75]
    assert found.array == pytest.approx(there.array[:1])
