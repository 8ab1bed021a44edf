"""Metrics of finding attackers."""

from __future__ import annotations

import math

import numpy as np
import pytest

import coopsim
from coopsim import Defense, Reception, Trust
from coopsim.metrics.finding import FINDING, area_under_curve
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.trust_log import TrustLog


def values(*logs: TrustLog) -> dict[str, float | None]:
    pool = LogPool([], records={"trust": logs})
    return {name: metric.value(pool) for name, metric in FINDING.items()}


def test_a_liar_is_found_from_its_first_lie_on() -> None:
    log = TrustLog()
    log.append({"a": 1.0, "b": 1.0}, [], 1)
    log.append({"a": 1.0, "b": 0.9}, ["b"], 3)  # b begins to lie
    log.append({"a": 0.4, "b": 0.8}, ["b"], 1)
    log.append({"a": 1.0, "b": 0.2}, [], 1)  # it keeps silent for a moment
    found = values(log)
    assert found["attacker_TPR"] == pytest.approx(100 / 3)
    assert found["attacker_FPR"] == pytest.approx(100 / 5)
    assert found["attackers_found"] == 100 and found["frames_until_found"] == 2
    assert found["defense_passes"] == 1.5
    other = TrustLog()
    other.append({"c": 0.9}, ["c"], 0)
    both = values(log, other)
    assert both["attackers_found"] == 50 and both["frames_until_found"] == 2


def test_area_under_the_curve() -> None:
    assert area_under_curve(np.array([0.1, 0.2, 0.9]), np.array([False, False, True])) == 1
    assert area_under_curve(np.array([0.1, 0.2, 0.1]), np.array([False, False, True])) == 0.25
    assert area_under_curve(np.ones(4), np.array([True, False, True, False])) == 0.5
    assert math.isnan(area_under_curve(np.ones(2), np.array([True, True])))


def test_honest_networks_have_rates_of_honest_senders_alone_and_none_without_defence() -> None:
    class DoubtsOne(Defense):
        def judge(self, reception: Reception) -> Trust:
            reception.find(reception.senders)
            return Trust(dict.fromkeys(reception.senders[:1], 0.0))

    options = {"seed": 1, "max_cycles": 4, "lidar": None, "vehicles": 8}
    score = coopsim.evaluate(coopsim.make_policy("late_fusion", defense=DoubtsOne), "crossing", **options).score
    assert score["attacker_FPR"] == pytest.approx(100 / 3) and score["defense_passes"] == 1
    assert math.isnan(score["attacker_TPR"]) and math.isnan(score["frames_until_found"])
    plain = coopsim.evaluate("late_fusion", "crossing", **options).score
    assert "attacker_FPR" not in plain.values
