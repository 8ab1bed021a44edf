"""What messages change: avoided and caused crashes, where the gain is gone, and what predicts crashes."""

from __future__ import annotations

import pytest

from coopsim.bench.grid.axis import AXES, Axis
from coopsim.bench.grid.cell import Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.paired import along, calm, change, gone_at, rank_correlation
from tests.helpers.crashes import RATES, crash_results


def test_a_pair_is_a_situation_with_a_seed() -> None:
    table = ResultTable.of(crash_results())
    found = change(table, table.policies.index("late_fusion"), calm(table))
    assert found is not None and (found.pairs, found.less, found.more) == (20, 6, 0)
    assert (found.alone, found.sharing) == (50.0, 20.0)
    assert found.change.mean == pytest.approx(-30.0) and found.change.low < -30 < found.change.high < 0
    assert found.p_value == pytest.approx(2 * 0.5**6), "six of six discordant pairs (McNemar)"


def test_crashes_that_come_with_messages_are_counted_apart() -> None:
    harmed = crash_results(lambda policy, condition, seed: seed == (0 if policy == "no_fusion" else 9))
    table = ResultTable.of(harmed)
    found = change(table, table.policies.index("coop_fuse"), calm(table, "merge"))
    assert found is not None and (found.pairs, found.less, found.more) == (10, 1, 1) and found.change.mean == 0


def test_the_gain_is_gone_where_it_stays_away() -> None:
    latencies = (0.0, 0.1, 0.3, 0.5)
    conditions = [Condition("merge", latency_s=each) for each in latencies]

    def crashes(policy: str, condition: Condition, seed: int) -> bool:
        return policy == "no_fusion" or (policy != "truth" and condition.latency_s > 0.2)

    table = ResultTable.of(crash_results(crashes, conditions))
    axis = next(each for each in AXES if each.option == "latency_s")
    assert gone(table, "late_fusion", axis) == "300 ms"
    assert gone(table, "truth", axis) == "not in these"


def gone(table: ResultTable, policy: str, axis: Axis) -> str:
    steps = along(table, axis)
    found = [(text, change(table, table.policies.index(policy), conditions)) for text, conditions in steps]
    return gone_at(axis, [(text, each) for text, each in found if each is not None])


def test_where_no_gain_is_shown_there_is_none_to_lose() -> None:
    conditions = [Condition("merge", latency_s=each) for each in (0.0, 0.3)]
    table = ResultTable.of(crash_results(lambda policy, condition, seed: seed < 2, conditions))
    axis = next(each for each in AXES if each.option == "latency_s")
    assert gone(table, "late_fusion", axis) == "0 ms: no gain shown"


def test_of_attacks_those_are_named_that_take_the_gain() -> None:
    conditions = [Condition("merge", attacks=each) for each in ("", "cav_1=ghost", "cav_1=remove")]

    def crashes(policy: str, condition: Condition, seed: int) -> bool:
        return policy == "no_fusion" or (policy != "truth" and "remove" in condition.attacks)

    table = ResultTable.of(crash_results(crashes, conditions))
    axis = next(each for each in AXES if each.option == "attacks")
    assert gone(table, "late_fusion", axis) == "cav_1=remove"
    assert gone(table, "truth", axis) == "none of these"


def test_a_run_alone_stands_for_conditions_that_it_does_not_feel() -> None:
    late = [Condition("merge", latency_s=each) for each in (0.0, 0.3)]
    everything = crash_results(conditions=late)
    sparse = [each for each in everything if each.cell.policy != "no_fusion" or not each.cell.condition.latency_s]
    whole, part = (ResultTable.of(each) for each in (everything, sparse))
    found = change(part, part.policies.index("late_fusion"), [1])
    assert found is not None and found == change(whole, whole.policies.index("late_fusion"), [1])


def test_a_metric_that_orders_policies_as_their_crashes_do_predicts_them() -> None:
    perfect = crash_results(AMOTA=lambda policy: -float(RATES[policy]), HOTA=lambda policy: float(len(policy)))
    table = ResultTable.of(perfect)
    found = rank_correlation(table, "AMOTA", calm(table))
    assert found is not None and found.value == pytest.approx(-1.0) and found.policies == 4, "the bound does not count"
    assert -1 <= found.low <= found.high < 0
    other = rank_correlation(table, "HOTA", calm(table))
    assert other is not None and abs(other.value) < 1
    assert rank_correlation(table, "IDF1", calm(table)) is None, "the results lack it"
