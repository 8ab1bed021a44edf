"""A superclass pools its classes: which of them a track says does not matter there, and matters everywhere else."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import Score, summarize
from coopsim.types import GroundTruth, Tracks
from coopsim.types.taxonomy import ObjectClass

CAR, VAN, TRUCK, PEDESTRIAN, CHILD = (ObjectClass[name] for name in ("CAR", "VAN", "TRUCK", "PEDESTRIAN", "CHILD"))


def boxes(count: int) -> Boxes3D:
    """20 m apart."""
    rows = np.tile([0.0, 0.0, 1.0, 4.0, 2.0, 2.0, 0.0], (count, 1))
    rows[:, 0] = 20.0 * np.arange(count)
    return Boxes3D.from_array(rows)


def score(truth: list[ObjectClass], reported: list[ObjectClass], frames: int = 5) -> Score:
    """Of tracks that are exactly on the objects, if not of their class."""
    evaluator, count = Evaluator(), len(truth)
    ids = np.arange(count)
    for _ in range(frames):
        tracks = Tracks(ids, boxes(count), np.zeros((count, 2)), np.full(count, 0.9), np.array(reported))
        counts = evaluator.update(GroundTruth(ids, boxes(count), np.array(truth)), tracks)
        assert counts.tp == sum(a == b for a, b in zip(truth, reported, strict=True))
    return summarize([evaluator.log])


def test_another_class_of_the_same_superclass_is_right_there_only() -> None:
    result = score([VAN, TRUCK, CAR], [TRUCK, TRUCK, CAR])
    assert set(result.superclasses) == {"Vehicle", "Truck"}
    assert result.superclasses["Truck"].all_tracks["MOTA"] == 100
    assert result.superclasses["Truck"].all_tracks["GT"] == 10
    assert result.classes["van"].all_tracks["TP"] == 0
    assert result.classes["truck"].all_tracks["FP"] == 5
    assert result.all_tracks["TP"] == 10 and result.all_tracks["GT"] == 15


def test_a_class_of_another_superclass_is_wrong() -> None:
    result = score([VAN, PEDESTRIAN], [CAR, CHILD])
    assert set(result.superclasses) == {"Truck", "Pedestrian"}
    assert result.superclasses["Truck"].all_tracks["TP"] == 0
    assert result.superclasses["Pedestrian"].all_tracks["MOTA"] == 100


@pytest.mark.parametrize("reported", [[CAR, CHILD], [CAR, PEDESTRIAN]])
def test_a_superclass_of_one_class_is_that_class(reported: list[ObjectClass]) -> None:
    result = score([CAR, PEDESTRIAN], reported)
    assert result.superclasses["Vehicle"].values == result.classes["car"].values
    if reported == [CAR, PEDESTRIAN]:
        assert result.superclasses["Pedestrian"].values == result.classes["pedestrian"].values


def test_tables_show_superclasses_of_several_classes() -> None:
    assert "Truck" in score([VAN, TRUCK], [VAN, TRUCK]).table()
    assert "Truck" not in score([TRUCK, CAR], [TRUCK, CAR]).table()


def test_the_mean_over_agents_and_the_dict_have_them() -> None:
    mean = Score.mean({"cav_0": score([VAN], [TRUCK]), "cav_1": score([CAR], [CAR])})
    assert set(mean.superclasses) == {"Truck", "Vehicle"}
    assert mean.to_dict()["superclasses"]["Truck"]["MOTA"] == 100
