"""FSCM's stages: a track that nothing is detected of becomes doubtful, so a doubtful detection may still be its."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.agents.boxes import VicFSCMAssociation
from coopsim.errors import UnknownNameError
from coopsim.geometry.boxes import Boxes3D


def test_a_track_is_doubtful_once_it_has_been_hidden_for_long() -> None:
    policy = VicFSCMAssociation()
    tracker = policy.make_tracker()
    for k in range(4):
        tracker.step(cars(0.0, score=0.9), k * FRAME_NS)
    scores = []
    for k in range(4, 20):
        tracker.step(cars(), k * FRAME_NS)
        scores.append(float(tracker.state.tracked.score[0]))
    assert scores == sorted(scores, reverse=True) and scores[0] < 0.9
    assert scores[0] >= policy.track_score > scores[-1]


def test_a_sure_track_comes_before_a_hidden_one() -> None:
    """Two tracks near one detection: the one seen all along is sure, the hidden one waits for the third stage."""
    hidden = VicFSCMAssociation().make_tracker()
    for k in range(4):
        hidden.step(cars(0.0, 2.0, score=0.9), k * FRAME_NS)
    for k in range(4, 16):  # what lies at 2 m is hidden
        hidden.step(cars(0.0, score=0.9), k * FRAME_NS)
    known = hidden.state.tracked
    assert known.id.tolist() == [1, 2]
    # Nearer to the hidden track; the sure one is asked first all the same.
    report = hidden.step(cars(1.2, score=0.9), 16 * FRAME_NS)
    after = hidden.state.tracked
    assert report.id.tolist() == [1] and after.misses[after.id == 2].tolist() == [13]


@pytest.mark.parametrize(("decay", "sure"), [(1.0, True), (0.5, False)])
def test_how_fast_it_falls_is_a_parameter(decay: float, sure: bool) -> None:
    policy = VicFSCMAssociation(score_decay=decay)
    tracker = policy.make_tracker()
    for k in range(4):
        tracker.step(cars(0.0, score=0.9), k * FRAME_NS)
    for k in range(4, 8):
        tracker.step(cars(), k * FRAME_NS)
    assert (tracker.state.tracked.score[0] >= policy.track_score) == sure


@pytest.mark.parametrize(("affinity", "matched"), [("xiou", False), ("axial_xiou", True), ("giou", True)])
def test_a_detection_that_faces_the_other_way_is_matched_unless_xiou_is_to_be(affinity: str, matched: bool) -> None:
    tracker = VicFSCMAssociation(affinity=affinity).make_tracker()
    for k in range(4):
        tracker.step(cars(0.0, score=0.9), k * FRAME_NS)
    seen = cars(0.0, score=0.9)
    around = replace(seen, boxes=Boxes3D.from_array(seen.boxes.array + np.pi * (np.arange(7) == 6)))
    tracker.step(around, 4 * FRAME_NS)
    assert (len(tracker.state.tracked) == 1) == matched


def test_an_unknown_affinity_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown affinity 'iou'"):
        VicFSCMAssociation(affinity="iou")
