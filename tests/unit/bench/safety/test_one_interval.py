"""A rate has one interval: the leaderboard, the answers on safety and the tables for papers agree."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.bench.grid.cell import Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import compare_with_best, standings
from coopsim.bench.results.statistics import rate_interval
from coopsim.bench.safety.safety_text import crash_rate
from tests.helpers.crashes import crash_results


def _crashes(policy: str, condition: Condition, seed: int) -> bool:
    return seed % 4 == 0 if condition.scenario == "merge" else seed == 1


def test_two_situations_of_a_seed_are_two_episodes_in_every_table() -> None:
    table = ResultTable.of(crash_results(_crashes))
    everywhere = range(len(table.conditions))
    whole = rate_interval(table.values("crash")[0].ravel())
    assert whole.count == 20
    for found in (
        crash_rate(table, 0, list(everywhere)),
        next(each.mean for each in standings(table, "crash") if each.policy == table.policies[0]),
        compare_with_best(table, "crash", everywhere)[0].interval,
    ):
        assert (found.mean, found.low, found.high) == pytest.approx((whole.mean, whole.low, whole.high))


def test_two_conditions_of_a_seed_count_once() -> None:
    late = [Condition("merge", latency_s=each) for each in (0.0, 0.3)]
    table = ResultTable.of(crash_results(_crashes, late))
    found = table.mean("crash", 0, range(2))
    assert found.count == 10 and found == rate_interval(table.values("crash")[0, 0])
    assert np.isnan(table.mean("crash", 0, []).mean)
