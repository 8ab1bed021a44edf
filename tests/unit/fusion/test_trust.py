"""The first one's box stands, unless it is doubtful; whoever sees an object adds to how sure it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.fusion.trust import trust_first
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections


def found(*objects: tuple[float, float], label: int = 0) -> Detections:
    rows = np.array([[x, 0, 0.8, 4.5, 1.9, 1.6, 0] for x, _ in objects]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(rows), [score for _, score in objects], np.full(len(rows), label))


def fused(*groups: Detections) -> list[tuple[float, float]]:
    kept = trust_first(groups, gate=0.1, floor=0.3)
    return sorted(zip(kept.boxes.center[:, 0].tolist(), kept.score.tolist(), strict=True))


def test_the_first_box_stands_with_the_best_score() -> None:
    assert fused(found((0, 0.5)), found((0.4, 0.9))) == [(0, 0.9)]
    assert fused(found((0, 0.9)), found((0.4, 0.5))) == [(0, 0.9)]


def test_a_doubtful_box_gives_way_to_a_better_one_only() -> None:
    assert fused(found((0, 0.2)), found((0.4, 0.9))) == [(0.4, 0.9)]
    assert fused(found((0, 0.2)), found((0.4, 0.1))) == [(0, 0.2)]
    # What stands now is the second one's, which is sure: the third only confirms it.
    assert fused(found((0, 0.2)), found((0.4, 0.5)), found((0.2, 0.9))) == [(0.4, 0.9)]


def test_what_only_one_sees_is_kept() -> None:
    assert fused(found((0, 0.5)), found((30, 0.6)), found((60, 0.7), (30, 0.4))) == [(0, 0.5), (30, 0.6), (60, 0.7)]


def test_boxes_of_one_agent_are_never_merged_and_classes_never_mix() -> None:
    assert len(fused(found((0, 0.5), (1, 0.6)))) == 2
    assert len(fused(found((0, 0.5)), found((0, 0.5), label=7))) == 2


def test_nobody_and_nothing() -> None:
    assert fused() == fused(found(), found()) == []
    rubbish = Detections(Boxes3D.from_array([[np.nan, 0, 0, 4, 2, 1.5, 0]]), [0.9], [0])
    assert fused(rubbish, found((0, 0.5))) == [(0, 0.5)]


@pytest.mark.parametrize(("gate", "floor"), [(1.5, 0.3), (float("nan"), 0.3), (0.1, -1), (0.1, float("nan"))])
def test_bad_settings(gate: float, floor: float) -> None:
    with pytest.raises(InvalidValueError, match="must be in"):
        trust_first([], gate, floor)


def test_covariance_and_embedding_go_with_the_box_that_stands() -> None:
    groups = [
        replace(
            found((0, 0.2), (30, 0.5)), covariance=np.stack([np.eye(7), 2 * np.eye(7)]), embedding=[[1, 0], [2, 0]]
        ),
        replace(found((0.4, 0.9), (30.4, 0.9)), covariance=np.stack([3 * np.eye(7)] * 2), embedding=[[3, 0], [4, 0]]),
        replace(found((60, 0.4)), covariance=5 * np.eye(7)[None], embedding=[[5, 0]]),
    ]
    kept = trust_first(groups, gate=0.1, floor=0.3)
    assert kept.boxes.center[:, 0].tolist() == [0.4, 30, 60] and kept.score.tolist() == [0.9, 0.9, 0.4]
    assert kept.covariance is not None and kept.covariance[:, 0, 0].tolist() == [3, 2, 5]
    assert kept.embedding is not None and kept.embedding[:, 0].tolist() == [3, 2, 5]


def test_embeddings_that_only_one_has_or_of_another_width_raise_nothing() -> None:
    groups = [found((0, 0.5)), replace(found((30, 0.5)), embedding=[[1, 2]]), replace(found((60, 1)), embedding=[[1]])]
    nan = [np.nan, np.nan]
    np.testing.assert_array_equal(trust_first(groups, gate=0.1, floor=0.3).embedding, [nan, [1, 2], nan])
