"""What the evaluator is given is checked before it is scored."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.types import GroundTruth, Tracks

ROWS = np.array([[0.0, 0, 0.8, 4, 2, 1.5, 0], [20, 0, 0.8, 4, 2, 1.5, 0]])


def truth(ids: Any = (1, 2), label: Any = (0, 0), rows: Any = ROWS) -> GroundTruth:
    return GroundTruth(ids, Boxes3D.from_array(rows), label)


def tracks(ids: Any = (1, 2), label: Any = (0, 0), rows: Any = ROWS) -> Tracks:
    return Tracks(ids, Boxes3D.from_array(rows), np.zeros((2, 2)), [0.5, 0.5], label)


def changed(row: int, column: int, value: float) -> np.ndarray:
    rows = ROWS.copy()
    rows[row, column] = value
    return rows


@pytest.mark.parametrize("make", [truth, tracks])
@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"ids": (1, 1)}, r"ids must be unique within a frame, got \[1\] more than once"),
        ({"label": (0, 42)}, r"labels must be in 0..8, got \[42\]"),
        ({"label": (0, -1)}, r"labels must be in 0..8, got \[-1\]"),
        ({"rows": changed(1, 0, np.nan)}, "must be finite, got nan"),
        ({"rows": changed(1, 3, 0.0)}, "sizes must be > 0"),
    ],
)
def test_what_cannot_be_scored_is_refused_and_changes_nothing(make: Any, wrong: dict[str, Any], match: str) -> None:
    evaluator = Evaluator()
    evaluator.update(truth(), tracks())
    pair = {"truth": truth(), "tracks": tracks()} | {make.__name__: make(**wrong)}
    with pytest.raises(InvalidValueError, match=match):
        evaluator.update(**pair)
    evaluator.update(truth(), tracks())
    assert len(evaluator.log) == 2
    assert summarize([evaluator.log])["MOTA"] == 100.0


def test_objects_must_be_as_many_as_their_ids() -> None:
    with pytest.raises(InvalidValueError, match=r"id must have shape \(2,\), got \(3,\)"):
        truth(ids=(1, 2, 3))


@pytest.mark.parametrize(("score", "velocity"), [((0.5, np.nan), 0.0), ((0.5, 0.5), np.inf)])
def test_numbers_of_tracks_must_be_finite(score: Any, velocity: float) -> None:
    evaluator, boxes = Evaluator(), Boxes3D.from_array(ROWS)
    with pytest.raises(InvalidValueError, match="must be finite"):
        evaluator.update(truth(), Tracks((1, 2), boxes, np.full((2, 2), velocity), score, (0, 0)))
    assert not len(evaluator.log)


def test_the_mask_of_the_region_is_a_mask_and_stays_the_callers() -> None:
    inside = np.array([True, False])
    counts = Evaluator().update(truth(), tracks(), inside)
    assert (counts.tp, counts.fp, counts.fn) == (1, 0, 1)
    assert inside.flags.writeable
    with pytest.raises(InvalidValueError, match="in_region"):
        Evaluator().update(truth(), tracks(), np.array([True]))
