"""A learned ranking: for any number of receivers and any policy, never beyond the budget, with clear errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from cars_in_a_row import boxes, message, observe
from small_env import SMALL

import coopsim
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.budget import make_selection
from coopsim.comms.uplinks.learned_selection import Learned
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.learn.weights import make_network, save_weights


@pytest.fixture
def weights(tmp_path: Path) -> str:
    return _saved(tmp_path / "random.safetensors", make_network("ranking", {"width": 8}))


def _saved(path: Path, net: torch.nn.Module) -> str:
    save_weights(path, net, {"kind": "ranking", "config": {"width": 8}})
    return str(path)


def test_a_row_says_what_the_sender_and_the_receivers_know_of_an_object(weights: str) -> None:
    ranking = make_selection(f"learned(weights={weights})", np.random.default_rng(0))
    assert isinstance(ranking, Learned)
    ranking.sent(message("cav_0", boxes([100.0])), DecodeOnce())
    inbox = message("cav_1", boxes([25.0], 0.7), x=75.0), message("cav_2", boxes([]), x=150.0, yaw=np.pi / 2)
    ranking.hear(observe(boxes([]), *inbox), DecodeOnce())
    rows = ranking.rows(observe(boxes([100.0, 50.0], 0.4)))
    # score, own distance, ahead, aside, distance, its own report, a third one's, nearest third, length, said last
    assert rows[0, 0] == pytest.approx([0.4, 2.0, 0.5, 0.0, 0.5, 0.7, 0.0, 1.0, 0.9, 1.0], abs=0.01)
    assert rows[0, 1] == pytest.approx([0.4, 1.0, -0.5, 0.0, 0.5, 0.0, 0.0, 2.0, 0.9, 0.0], abs=0.01)
    assert rows[1, 0] == pytest.approx([0.4, 2.0, 0.0, 1.0, 1.0, 0.0, 0.7, 0.5, 0.9, 1.0], abs=0.01)


def test_the_utility_is_the_mean_gain_of_the_receivers_and_the_bonus(tmp_path: Path) -> None:
    net = make_network("ranking", {"width": 8})
    net.keep.data.fill_(0.5)
    ranking = Learned(np.random.default_rng(0), _saved(tmp_path / "bonus.safetensors", net))
    ranking.sent(message("cav_0", boxes([30.0])), DecodeOnce())
    ranking.hear(observe(boxes([]), message("cav_1", boxes([]), x=60.0), message("b", boxes([]), x=9.0)), DecodeOnce())
    seen = observe(boxes([30.0, 40.0]))
    expected = ranking.net.gains(ranking.rows(seen)).mean(axis=0) + np.array([0.5, 0.0])
    assert ranking.utility("cav_0", seen) == pytest.approx(expected)


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
