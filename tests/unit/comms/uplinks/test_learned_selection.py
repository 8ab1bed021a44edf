"""A learned ranking: begins as "need", learns a rhythm, keeps to the budget with any policy, with clear errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import SMALL

import coopsim
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.budget import make_selection
from coopsim.comms.uplinks.learned_selection import Learned
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.learn.weights import make_network, save_weights
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate


def boxes(x: list[float], score: float = 0.5) -> Detections:
    rows = np.array([[each, 0.0, 0.8, 4.5, 1.9, 1.6, 0.0] for each in x]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(rows), np.full(len(x), score), np.zeros(len(x), dtype=int))


def observe(found: Detections, *inbox: Message, x: float = 0.0, yaw: float = 0.0) -> Observation:
    return Observation(0, PoseEstimate(np.array([x, 0.0, 0.0, yaw])), Odometry(np.zeros(4)), found, inbox=inbox)


def message(sender: str, found: Detections, x: float = 0.0, yaw: float = 0.0) -> Message:
    sent = ShareDetections().message(sender, observe(found, x=x, yaw=yaw))
    assert sent is not None
    return sent


@pytest.fixture
def weights(tmp_path: Path) -> str:
    return _saved(tmp_path / "first.safetensors", make_network("ranking", {}))


def _saved(path: Path, net: torch.nn.Module) -> str:
    save_weights(path, net, {"kind": "ranking", "config": {}})
    return str(path)


def test_untrained_it_is_the_rule_need(weights: str) -> None:
    scores = [
        coopsim.evaluate("late_fusion", **SMALL, budget_bytes=150, seed=3, selection=selection).score
        for selection in ("need", f"learned(weights={weights})")
    ]
    assert scores[0].values == scores[1].values


def test_a_row_says_what_the_others_know_and_when_an_object_was_said(weights: str) -> None:
    ranking = make_selection(f"learned(weights={weights})", np.random.default_rng(0))
    assert isinstance(ranking, Learned)
    found = boxes([100.0, 50.0], 0.4)
    ranking.hear(observe(boxes([]), message("cav_1", boxes([25.0], 0.7), x=75.0)), DecodeOnce())
    row = ranking.rows("cav_0", observe(found))
    away = np.array([25.0, 25.0]) / 40.0  # both are 25 m from the receiver, and it reported the one at 100 m
    assert row[:, 0] == pytest.approx(np.log([0.4, 0.4]))
    assert row[:, 1] == pytest.approx(np.log(-np.expm1(-(away**2))))
    assert row[:, 2].tolist() == [1, 0] and not row[:, 3:].any()


def test_the_rhythm_counts_frames_since_an_object_was_said_and_how_often(weights: str) -> None:
    """One of two objects fits into each message, so half of the rhythm is scarce. The objects move 1 m a frame."""
    ranking = Learned(np.random.default_rng(0), weights)
    said_last, often = [], []
    for frame, said in enumerate([0, 0, 0, 1, 1, 1, 1]):
        x = [30.0 + frame, 60.0 + frame]
        rows = ranking.rows("cav_0", observe(boxes(x)))
        assert rows[:, 3:7] == pytest.approx(rows[:, 7:]), "scarce is 1 / 2, once something was said"
        said_last.append(2 * rows[0, 3:7])
        often.append(2 * rows[1, 3:7])
        ranking.sent(message("cav_0", boxes([x[said]])), DecodeOnce())
    none, unconfirmed, confirmed, before, third = [0] * 4, [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]
    assert np.array(said_last).tolist() == [none, unconfirmed, unconfirmed, confirmed, before, third, none]
    assert np.array(often).tolist() == [none, none, none, none, unconfirmed, unconfirmed, confirmed]


def test_lost_messages_make_the_rhythm_count_less(weights: str) -> None:
    heard, lost = (Learned(np.random.default_rng(0), weights) for _ in "ab")
    arrived = message("cav_1", boxes([]), x=60.0)
    for ranking in (heard, lost):
        ranking.hear(observe(boxes([]), arrived), DecodeOnce())
        ranking.sent(message("cav_0", boxes([30.0])), DecodeOnce())
    heard.hear(observe(boxes([]), arrived), DecodeOnce())
    lost.hear(observe(boxes([])), DecodeOnce())
    scarce = [ranking.rows("cav_0", observe(boxes([30.0])))[0, 3] for ranking in (heard, lost)]
    assert scarce[1] == pytest.approx(0.9**4 * scarce[0])


def test_where_nobody_is_heard_the_surest_come_first(weights: str) -> None:
    ranking = Learned(np.random.default_rng(0), weights)
    assert ranking.order("cav_0", observe(boxes([1.0, 9.0], 0.3))).tolist() == [0, 1]
    ranking.hear(observe(boxes([]), message("cav_1", boxes([]))), DecodeOnce())
    assert ranking.order("cav_0", observe(boxes([]))).tolist() == []


@pytest.mark.parametrize("policy", ["late_fusion", "coop_fuse"])
@pytest.mark.parametrize("budget_bytes", [150, 400])
def test_no_message_is_larger_than_its_budget_and_all_is_repeatable(
    weights: str, policy: str, budget_bytes: int
) -> None:
    options = {**SMALL, "budget_bytes": budget_bytes, "selection": f"learned(weights={weights})"}
    first, again = (coopsim.evaluate(policy, **options, seed=1).score for _ in "ab")
    assert 0 < first["bytes_per_s"] <= 10 * budget_bytes
    assert first.values == again.values


def test_what_is_not_accepted_is_said(weights: str, tmp_path: Path) -> None:
    def evaluate(selection: str) -> None:
        coopsim.evaluate("late_fusion", **SMALL, budget_bytes=150, selection=selection)

    with pytest.raises(UnknownNameError, match="weights"):
        evaluate(f"learned(weight={weights})")
    with pytest.raises(InvalidValueError, match=r"nowhere\.safetensors"):
        evaluate(f"learned(weights={tmp_path / 'nowhere.safetensors'})")
    with pytest.raises(InvalidValueError, match="must be weights of the kind 'ranking'"):
        evaluate("learned(weights=pillars)")
