"""A score becomes a probability that also knows how far off and how large a box is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from coopsim.fusion.fused_boxes import Calibration, FusedBoxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections

CALIBRATION = Calibration(bias=-4.0, score=9.0, away=-0.04, volume=0.8, chance=0.7)


def box(score: float, size: tuple[float, float, float] = (4.5, 1.9, 1.6)) -> Detections:
    return Detections(Boxes3D.from_array([[7, -3, 0.8, *size, 0.3]]), [score], [0])


def believed(found: Detections, nearest_m: ArrayLike, chance: ArrayLike = 1.0) -> FusedBoxes:
    nearest_m, chance = (np.broadcast_to(np.asarray(each, float), (len(found),)) for each in (nearest_m, chance))
    return FusedBoxes(found, chance, nearest_m, found.score, nearest_m)


def probability(found: Detections, away_m: float, chance: float = 1.0) -> float:
    return float(CALIBRATION.of(believed(found, away_m, chance))[0])


def test_every_weight_is_of_its_own_feature() -> None:
    log_odds = -4 + 9 * 0.5 - 0.04 * 20 + 0.8 * np.log(4 * 2 * 1.5)
    assert probability(box(0.5, (4, 2, 1.5)), 20) == pytest.approx(1 / (1 + np.exp(-log_odds)))
    # Of boxes that exclude each other one at most is right, however clear both are.
    assert probability(box(0.5, (4, 2, 1.5)), 20, 0.3) == pytest.approx(0.3**0.7 / (1 + np.exp(-log_odds)))


@given(score=st.floats(0, 0.9), away_m=st.floats(0, 100), more=st.floats(0.05, 0.1))
def test_likelier_with_a_better_score_a_nearer_agent_and_a_larger_box(score: float, away_m: float, more: float) -> None:
    before = probability(box(score), away_m)
    assert probability(box(score + more), away_m) > before
    assert probability(box(score), away_m + more) < before
    assert probability(box(score, (4.5 + more, 1.9, 1.6)), away_m) > before


def test_the_order_of_boxes_does_not_matter_and_none_is_none() -> None:
    rows = [[0, 0, 0, 4, 2, 1.5, 0], [9, 0, 0, 12, 3, 3.5, 1], [20, 1, 0, 0.6, 0.6, 1.7, 2]]
    found, away = Detections(Boxes3D.from_array(rows), [0.9, 0.4, 0.1], [0, 0, 0]), np.array([3.0, 50.0, 20.0])
    np.testing.assert_array_equal(
        CALIBRATION.of(believed(found[::-1], away[::-1])), CALIBRATION.of(believed(found, away))[::-1]
    )
    assert CALIBRATION.of(believed(Detections.empty(), [])).shape == (0,)


@pytest.mark.parametrize("size", [(1e-300, 1e-300, 1e-300), (1e200, 1e200, 1e200)])
def test_sizes_and_distances_beyond_reason_stay_probabilities(size: tuple[float, float, float]) -> None:
    for away_m, chance in ((0.0, 0.0), (1e9, 1.0)):
        assert 0 <= probability(box(0.5, size), away_m, chance) <= 1
