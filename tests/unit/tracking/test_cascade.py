"""Stages take what is theirs from what is left, and classes never mix."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import cars, tracks

from coopsim.errors import InvalidValueError
from coopsim.geometry.assignment import greedy, hungarian
from coopsim.tracking.affinity import center_distance, giou_3d, iou_3d
from coopsim.tracking.cascade import Cascade, Stage, score_below, score_from
from coopsim.tracking.track_states import TrackStates
from coopsim.types import Detections
from coopsim.types.taxonomy import SUPERCLASS_NUMBERS


def pairs(cascade: Cascade, known: TrackStates, found: Detections) -> list[tuple[int, int]]:
    rows, columns = cascade.match(known, found)
    return sorted(zip(rows.tolist(), columns.tolist(), strict=True))


def test_classes_never_mix() -> None:
    cascade = Cascade([Stage(giou_3d, hungarian, gate=-1.0)])
    assert pairs(cascade, tracks(0, 10, label=[0, 7]), cars(0.1, 10.1, label=[7, 0])) == [(0, 1), (1, 0)]
    assert pairs(cascade, tracks(0, label=0), cars(0, label=7)) == []


def test_later_stages_get_what_is_left() -> None:
    cascade = Cascade([Stage(iou_3d, hungarian, 0.5), Stage(center_distance, greedy, -6.0)])
    assert pairs(cascade, tracks(0, 20, 50), cars(25, 0.2, 70)) == [(0, 1), (1, 0)]


@pytest.mark.parametrize(("known", "found"), [((), (1.0,)), ((1.0,), ()), ((), ())])
def test_nothing_to_match(known: tuple[float, ...], found: tuple[float, ...]) -> None:
    assert pairs(Cascade([Stage(giou_3d, hungarian, -0.2)]), tracks(*known), cars(*found)) == []


def test_a_stage_may_be_for_some_only() -> None:
    """Two detections on one track: the surer one comes first, although the other is nearer."""
    sure, unsure = score_from(0.5), score_below(0.5)
    found = cars(0.0, 1.0, 20.0, score=[0.2, 0.9, 0.2])
    first = Stage(center_distance, hungarian, -3.0, detections=sure)
    assert pairs(Cascade([first]), tracks(0, 20), found) == [(0, 1)]
    assert pairs(
        Cascade([first, Stage(center_distance, hungarian, -3.0, detections=unsure)]), tracks(0, 20), found
    ) == [
        (0, 1),
        (1, 2),
    ]
    lost = Stage(center_distance, hungarian, -3.0, tracks=score_below(0.3))
    assert pairs(Cascade([lost]), tracks(0, 20, score=[0.9, 0.1]), found) == [(1, 2)]


def test_classes_of_one_group_match_where_asked() -> None:
    known, found = tracks(0, 10, label=[2, 0]), cars(0.1, 10.1, label=[3, 2])
    stages = [Stage(giou_3d, hungarian, gate=-0.2)]
    assert pairs(Cascade(stages), known, found) == []
    assert pairs(Cascade(stages, SUPERCLASS_NUMBERS), known, found) == [(0, 0)]


def test_an_empty_stage_does_not_end_the_cascade() -> None:
    nobody = Stage(giou_3d, hungarian, -0.2, detections=score_from(2.0))
    assert pairs(Cascade([nobody, Stage(giou_3d, hungarian, -0.2)]), tracks(0), cars(0)) == [(0, 0)]


def test_a_gate_must_be_finite() -> None:
    with pytest.raises(InvalidValueError, match="gate must be a finite number, got nan"):
        Stage(giou_3d, hungarian, float("nan"))


def test_affinities_of_boxes_are_larger_for_who_is_nearer() -> None:
    for affinity in (center_distance, giou_3d, iou_3d):
        near, far = affinity(tracks(0), cars(0.5, 3))[0]
        assert near > far
    np.testing.assert_allclose(center_distance(tracks(0, 4), cars(1)), [[-1], [-3]])
