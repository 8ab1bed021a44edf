"""Of two agents' boxes on an object the likelier one weighs more; whoever sees it adds to how sure it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.fusion.box_fusion import trust_likelier
from coopsim.fusion.fused_boxes import AWAY, SourceOdds, pair_features, probability_other, rows_of_agent
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections

# Decides by the scores alone, and sharply: the better-scored box is right.
BY_SCORE = SourceOdds(bias=0, own_score=-200, other_score=200, own_away=0, other_away=0, gap=0, gap_away=0)
UNDECIDED = SourceOdds(bias=0, own_score=0, other_score=0, own_away=0, other_away=0, gap=0, gap_away=0)


def found(*objects: tuple[float, float], label: int = 0, bottom_m: float = 0.0) -> Detections:
    rows = np.array([[x, 0, 0.8 + bottom_m, 4.5, 1.9, 1.6, 0] for x, _ in objects]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(rows), [score for _, score in objects], np.full(len(rows), label))


def fused(*groups: Detections, doubt: SourceOdds = BY_SCORE) -> list[tuple[float, float]]:
    kept = trust_likelier(groups, gate=0.1, doubt=doubt).detections
    return sorted(zip(kept.boxes.center[:, 0].tolist(), kept.score.tolist(), strict=True))


def test_the_likelier_box_with_the_best_score() -> None:
    assert fused(found((0, 0.5)), found((0.4, 0.9))) == [(pytest.approx(0.4), 0.9)]
    assert fused(found((0, 0.9)), found((0.4, 0.5))) == [(pytest.approx(0), 0.9)]


def test_between_equals_one_box_that_overlaps_all_of_them() -> None:
    for places in ((0, 0.4), (0, 0.4, 0.6)):
        ((x, score),) = fused(*(found((each, 0.5)) for each in places), doubt=UNDECIDED)
        assert min(places) - 1e-9 <= x <= max(places) + 1e-9 and score == 0.5
    # Too far apart for either of the two to be within reach of the other: in the middle there is one that is.
    ((x, _),) = fused(found((0, 0.5)), found((3.2, 0.5)), doubt=UNDECIDED)
    assert x == pytest.approx(1.6)


@pytest.mark.parametrize("gap_m", [0.0, 0.5, 1.2, -1.2])
def test_a_height_that_both_reach_where_there_is_one(gap_m: float) -> None:
    kept = trust_likelier([found((0, 0.6)), found((0, 0.5), bottom_m=gap_m)], gate=-0.5, doubt=UNDECIDED).detections
    assert kept.boxes.center[0, 2] - 0.8 == pytest.approx(gap_m / 2)


@pytest.mark.parametrize("gap_m", [1.5, 2.2, -2.2])
def test_a_taller_box_reaches_both_where_none_of_their_size_does(gap_m: float) -> None:
    groups = [found((0, 0.6)), found((0, 0.5), bottom_m=gap_m)]
    kept = trust_likelier(groups, gate=-0.5, doubt=UNDECIDED).detections
    assert kept.boxes.center[0, 2] - 0.8 == pytest.approx(gap_m / 2)
    assert 1.6 < kept.boxes.size[0, 2] <= 1.6 + abs(gap_m) + 1e-9
    assert all(iou_3d(kept.boxes.array, group.boxes.array)[0, 0] >= 0.25 for group in groups)


HEIGHTS_M, PROBABILITIES = st.floats(0.5, 4.0), st.floats(0.01, 0.99)


@given(st.floats(-9.0, 9.0), HEIGHTS_M, HEIGHTS_M, PROBABILITIES)
def test_never_less_likely_on_the_object_than_either_of_the_two(
    gap_m: float, own_m: float, other_m: float, share: float
) -> None:
    own, other = (
        replace(each, boxes=Boxes3D([[0, 0, floor_m + height_m / 2]], [[4.5, 1.9, height_m]], [0.0]))
        for each, floor_m, height_m in ((found((0, 0.5)), 0.0, own_m), (found((0, 0.5)), gap_m, other_m))
    )
    odds = replace(UNDECIDED, bias=float(np.log(share / (1 - share))))
    kept = trust_likelier([own, other], gate=-0.5, doubt=odds).detections

    def chance_of(boxes: Boxes3D) -> float:
        overlap = np.array([iou_3d(boxes.array, each.boxes.array)[0, 0] for each in (own, other)])
        return float(np.dot([1 - share, share], 1 / (1 + np.exp((0.25 - overlap) / 0.03))))

    # A hundredth, as what overlaps more is worth a little more.
    assert chance_of(kept.boxes) >= max(chance_of(own.boxes), chance_of(other.boxes)) - 0.01


def test_else_the_height_of_the_likelier() -> None:
    for own, expected in ((0.6, 0.0), (0.4, 3.0)):
        groups = [found((0, own)), found((0, 0.5), bottom_m=3.0)]
        kept = trust_likelier(groups, gate=-0.5, doubt=replace(BY_SCORE, own_score=-30, other_score=30)).detections
        assert kept.boxes.center[0, 2] - 0.8 == pytest.approx(expected)


ODDS_OF_A_QUARTER = replace(UNDECIDED, bias=float(np.log(0.25 / 0.75)))


def test_a_height_that_is_given_up_may_stay_as_a_box_of_its_own() -> None:
    groups = [found((0, 0.4), (30, 0.7)), found((0.4, 0.6), bottom_m=4.0)]
    kept = trust_likelier(groups, gate=-0.5, doubt=ODDS_OF_A_QUARTER, least_chance=0.2)
    np.testing.assert_allclose(iou_3d(kept.detections.boxes.array[:1], groups[0].boxes.array), [[1, 0]], atol=0.4)
    np.testing.assert_allclose(kept.detections.boxes.center[1:], [[30, 0, 0.8], [0.4, 0, 4.8]], atol=1e-12)
    assert kept.detections.score.tolist() == [0.6, 0.7, 0.6]
    np.testing.assert_allclose(kept.chance, [0.75, 1, 0.25], atol=1e-3)
    assert len(trust_likelier(groups, gate=-0.5, doubt=ODDS_OF_A_QUARTER, least_chance=0.3).detections) == 2
    assert len(trust_likelier(groups, gate=-0.5, doubt=ODDS_OF_A_QUARTER).detections) == 2
    # Also if it is the own one.
    mirrored = replace(ODDS_OF_A_QUARTER, bias=-ODDS_OF_A_QUARTER.bias)
    kept = trust_likelier(groups, gate=-0.5, doubt=mirrored, least_chance=0.2)
    np.testing.assert_allclose(kept.detections.boxes.center[:, 2], [4.8, 0.8, 0.8], atol=0.3)


@given(st.floats(0.0, 9.0), PROBABILITIES)
def test_what_is_kept_of_a_box_is_the_chance_that_the_fused_one_misses(gap_m: float, share: float) -> None:
    groups = [found((0, 0.5)), found((0, 0.5), bottom_m=gap_m)]
    odds = replace(UNDECIDED, bias=float(np.log(share / (1 - share))))
    kept = trust_likelier(groups, gate=-0.5, doubt=odds, least_chance=0.0)
    assert 0.7 <= kept.chance.sum() <= 1.2
    overlap = iou_3d(kept.detections.boxes.array[:1], kept.detections.boxes.array[1:])[0]
    for chance, right, overlapped in zip(kept.chance[1:], (1 - share, share), overlap, strict=True):
        assert chance <= right + 1e-9
        assert chance <= 0.05 or overlapped < 0.45


@given(st.floats(-9.0, 9.0), PROBABILITIES)
def test_nothing_is_out_of_reach_if_all_that_is_given_up_stays(gap_m: float, share: float) -> None:
    groups = [found((0, 0.5)), found((0, 0.5), bottom_m=gap_m)]
    odds = replace(UNDECIDED, bias=float(np.log(share / (1 - share))))
    kept = trust_likelier(groups, gate=-0.5, doubt=odds, least_chance=0.0).detections
    for each in groups:
        assert iou_3d(kept.boxes.array, each.boxes.array).max() >= 0.25


def test_a_third_agent_that_is_surely_right_leaves_no_doubt_from_the_first_two() -> None:
    undecided = [found((0, 0.5)), found((0, 0.5), bottom_m=4.0)]
    assert trust_likelier(undecided, gate=-0.5, doubt=BY_SCORE).chance == pytest.approx(0.5, abs=0.01)
    sure, doubtful = (found((0, score), bottom_m=-4.0) for score in (0.9, 0.1))
    assert trust_likelier([*undecided, sure], gate=-0.5, doubt=BY_SCORE).chance == pytest.approx(1, abs=0.01)
    assert trust_likelier([*undecided, doubtful], gate=-0.5, doubt=BY_SCORE).chance == pytest.approx(0.5, abs=0.01)


def test_what_an_agent_sees_clearly_is_where_its_good_scores_are() -> None:
    def away_m(*boxes: tuple[float, float]) -> Floats:
        seen = found(*boxes)
        return rows_of_agent(seen.boxes.array, seen.score.copy(), seen.label.copy(), 0)[:, AWAY]

    away = away_m((0, 0.8), (10, 0.8), (100, 0.01))
    np.testing.assert_allclose(away, [5, 5, 95], atol=0.01)
    assert len(away_m()) == 0
    assert np.isfinite(away_m((0, 0.0), (10, -3.0))).all()
    np.testing.assert_allclose(away_m((0, 1e300), (10, 0.5)), [0, 10])


def test_how_far_a_fused_box_is_from_what_the_nearest_agent_sees_clearly() -> None:
    near_first, near_last = found((0, 0.9), (40, 0.01)), found((0, 0.01), (40, 0.9), (70, 0.01))
    kept = trust_likelier([near_first, near_last], gate=0.1, doubt=BY_SCORE)
    assert kept.detections.boxes.center[:, 0].tolist() == [0, 40, 70]
    np.testing.assert_allclose(kept.nearest_m, [0, 0, 30], atol=0.01)
    swapped = trust_likelier([near_last, near_first], gate=0.1, doubt=BY_SCORE)
    assert swapped.detections.boxes.center[:, 0].tolist() == [0, 40, 70]
    np.testing.assert_allclose(swapped.nearest_m, kept.nearest_m)


def test_every_weight_is_of_its_own_feature() -> None:
    values = [np.array([value]) for value in (2.0, 3.0, 5.0, 7.0, -11.0)]
    features = pair_features(*values)
    assert features.tolist() == [[2, 3, 5, 7, 11, 55]]
    log_odds = 0.1 + 2 * 0.01 - 3 * 0.02 + 5 * 0.03 - 7 * 0.04 + 11 * 0.05 - 55 * 0.001
    assert probability_other(SourceOdds(0.1, 0.01, -0.02, 0.03, -0.04, 0.05, -0.001).weights, features)[
        0
    ] == pytest.approx(1 / (1 + np.exp(-log_odds)))


def test_what_only_one_sees_is_kept() -> None:
    assert fused(found((0, 0.5)), found((30, 0.6)), found((60, 0.7), (30, 0.4))) == [(0, 0.5), (30, 0.6), (60, 0.7)]


def test_boxes_of_one_agent_are_never_merged_and_classes_never_mix() -> None:
    assert len(fused(found((0, 0.5), (1, 0.6)))) == 2
    assert len(fused(found((0, 0.5)), found((0, 0.5), label=7))) == 2


HEARSAY = replace(UNDECIDED, bias=float(np.log(0.8 / 0.2)))


def tilted(*x: float, rise: float = 0.0) -> Detections:
    """What an agent says whose pose is tilted: higher by `rise` metres per metre."""
    rows = np.array([[each, each % 7, 0.8 + rise * each, 4.5, 1.9, 1.6, 0] for each in x])
    return Detections(Boxes3D.from_array(rows), np.full(len(x), 0.8), np.zeros(len(x), int))


def test_what_only_another_sees_may_lie_where_registration_puts_it() -> None:
    common = range(5, 45, 5)
    own, other = tilted(*common), tilted(*common, 60, rise=0.07)
    kept = trust_likelier([own, other], 0.1, UNDECIDED, HEARSAY, least_chance=0.1)
    said, registered = other.boxes.array[-1:], tilted(60).boxes.array
    assert iou_3d(kept.detections.boxes.array, said).max() >= 0.25
    assert iou_3d(kept.detections.boxes.array, registered).max() >= 0.25
    far = kept.detections.boxes.center[:, 0] > 50
    assert kept.detections.score[far].tolist() == [0.8, 0.8]
    np.testing.assert_allclose(kept.chance[far], [0.8, 0.2], atol=0.02)
    # Without an opinion about hearsay it is believed.
    kept = trust_likelier([own, other], 0.1, UNDECIDED, least_chance=0.1)
    np.testing.assert_array_equal(kept.detections.boxes.array[kept.detections.boxes.center[:, 0] > 50], said)


def test_hearsay_is_believed_where_nothing_is_common_or_nothing_differs() -> None:
    for groups in ([tilted(5), tilted(60, 70)], [found(), tilted(60, 70)], [tilted(5, 15), tilted(5, 15, 60, 70)]):
        kept = trust_likelier(groups, 0.1, UNDECIDED, HEARSAY, least_chance=0.1)
        expected = groups[1].boxes.array[-2:]
        np.testing.assert_allclose(kept.detections.boxes.array[-2:], expected, atol=0.05)


def test_nobody_and_nothing() -> None:
    assert fused() == fused(found(), found()) == []
    rubbish = Detections(Boxes3D.from_array([[np.nan, 0, 0, 4, 2, 1.5, 0]]), [0.9], [0])
    assert fused(rubbish, found((0, 0.5))) == [(0, 0.5)]


def test_covariance_and_embedding_go_with_the_likelier_box() -> None:
    groups = [
        replace(
            found((0, 0.2), (30, 0.5)), covariance=np.stack([np.eye(7), 2 * np.eye(7)]), embedding=[[1, 0], [2, 0]]
        ),
        replace(found((0.4, 0.9), (30.4, 0.4)), covariance=np.stack([3 * np.eye(7)] * 2), embedding=[[3, 0], [4, 0]]),
        replace(found((60, 0.4)), covariance=5 * np.eye(7)[None], embedding=[[5, 0]]),
    ]
    kept = trust_likelier(groups, gate=0.1, doubt=BY_SCORE).detections
    np.testing.assert_allclose(kept.boxes.center[:, 0], [0.4, 30, 60])
    assert kept.covariance is not None and kept.covariance[:, 0, 0].tolist() == [3, 2, 5]
    assert kept.embedding is not None and kept.embedding[:, 0].tolist() == [3, 2, 5]


def test_embeddings_that_only_one_has_or_of_another_width_raise_nothing() -> None:
    groups = [found((0, 0.5)), replace(found((30, 0.5)), embedding=[[1, 2]]), replace(found((60, 1)), embedding=[[1]])]
    nan = [np.nan, np.nan]
    np.testing.assert_array_equal(trust_likelier(groups, 0.1, BY_SCORE).detections.embedding, [nan, [1, 2], nan])
