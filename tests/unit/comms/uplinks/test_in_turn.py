"""The ranking "in_turn": "need" where all fits, else objects of the last message wait while others are said."""

from __future__ import annotations

import numpy as np
import pytest
from cars_in_a_row import boxes, message, observe
from small_env import SMALL

import coopsim
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.uplinks.budget import make_selection
from coopsim.comms.uplinks.in_turn import InTurn


def ranking() -> InTurn:
    made = make_selection("in_turn", np.random.default_rng(0))
    assert isinstance(made, InTurn)
    return made


def test_where_all_fits_it_is_the_rule_need() -> None:
    in_turn, need = ranking(), make_selection("need", np.random.default_rng(0))
    found, heard = boxes([20.0, 50.0, 90.0]), message("cav_1", boxes([25.0], 0.7), x=75.0)
    for _ in range(5):
        for each in (in_turn, need):
            each.hear(observe(boxes([]), heard), DecodeOnce())
        assert in_turn.utility("cav_0", observe(found)) == pytest.approx(need.utility("cav_0", observe(found)))
        for each in (in_turn, need):
            each.sent(message("cav_0", found), DecodeOnce())


def test_where_one_of_two_fits_they_are_said_in_turn_once_trackers_know_them() -> None:
    each, said = ranking(), []
    for frame in range(12):
        found = boxes([30.0 + frame, 60.0 + frame])  # they move 1 m a frame
        first = int(each.order("cav_0", observe(found))[0])
        each.sent(message("cav_0", found[[first]]), DecodeOnce())
        said.append(first)
    assert said[6:] in ([0, 1] * 3, [1, 0] * 3)


def test_lost_messages_make_the_rhythm_count_less() -> None:
    heard, lost = ranking(), ranking()
    arrived, found = message("cav_1", boxes([]), x=60.0), boxes([30.0, 90.0])
    for each in (heard, lost):
        each.hear(observe(boxes([]), arrived), DecodeOnce())
        each.utility("cav_0", observe(found))
        each.sent(message("cav_0", boxes([30.0])), DecodeOnce())
    heard.hear(observe(boxes([]), arrived), DecodeOnce())
    lost.hear(observe(boxes([])), DecodeOnce())
    rests = [each.utility("cav_0", observe(found))[0] for each in (heard, lost)]
    assert rests[0] < rests[1], "what was said rests less where messages are lost"


@pytest.mark.parametrize("policy", ["late_fusion", "coop_fuse"])
def test_no_message_is_larger_than_its_budget_and_all_is_repeatable(policy: str) -> None:
    options = {**SMALL, "budget_bytes": 150, "selection": "in_turn"}
    first, again = (coopsim.evaluate(policy, **options, seed=1).score for _ in "ab")
    assert 0 < first["bytes_per_s"] <= 1500
    assert first.values == again.values
