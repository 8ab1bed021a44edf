"""Rates have the intervals and p-values of published examples, and few crashes are told as such."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from synthetic_results import results

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.paper.tables import latex_tables
from coopsim.bench.results.comparison import DEFAULT_METRICS, compare_results
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import standings
from coopsim.bench.results.statistics import (
    holm,
    rate_difference,
    rate_interval,
    seeds_needed,
    sign_flip_p_value,
    smallest_p_value,
)
from coopsim.bench.text.bench_text import to_markdown
from coopsim.bench.text.comparison_text import to_dict, to_text


def flags(yes: int, count: int) -> NDArray[np.float64]:
    return np.repeat([100.0, 0.0], [yes, count - yes])


def pairs(both: int, first: int, second: int, neither: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values of A and B of a table of pairs: both yes, only A, only B, neither."""
    counts = [both, first, second, neither]
    return np.repeat([100.0, 100.0, 0.0, 0.0], counts), np.repeat([100.0, 0.0, 100.0, 0.0], counts)


@pytest.mark.parametrize(
    ("yes", "count", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_s_interval_is_that_of_newcombe_1998_table_1(yes: int, count: int, low: float, high: float) -> None:
    interval = rate_interval(flags(yes, count))
    assert interval.mean == pytest.approx(100 * yes / count)
    assert (interval.low / 100, interval.high / 100) == (pytest.approx(low, abs=5e-5), pytest.approx(high, abs=5e-5))
    assert interval.count == count


def test_nan_is_left_out_and_of_nothing_there_is_no_rate() -> None:
    assert rate_interval(np.array([np.nan, 100.0, 0.0])) == rate_interval(np.array([100.0, 0.0]))
    assert rate_interval(np.full(3, np.nan)).count == 0


def test_without_a_crash_the_interval_has_a_length() -> None:
    interval = rate_interval(flags(0, 100))
    assert interval.low == interval.mean == 0
    assert interval.high == pytest.approx(3.70, abs=0.01)
    assert interval.is_rate
    assert min(interval.whiskers) == 0 < max(interval.whiskers)


def test_means_of_independent_conditions_narrow_the_interval_and_those_of_equal_ones_do_not() -> None:
    crashes = np.random.default_rng(0).random((100, 8)) < 0.2
    alone = rate_interval(100.0 * crashes[:, 0])
    eight = rate_interval(100.0 * crashes.mean(axis=1))
    pooled = rate_interval(100.0 * crashes.ravel())
    again = rate_interval(100.0 * crashes[:, [0] * 8].mean(axis=1))
    assert eight.half_width == pytest.approx(pooled.half_width, rel=0.15)
    assert eight.half_width < 0.5 * alone.half_width
    assert again == alone


def test_intervals_of_rates_cover() -> None:
    rng = np.random.default_rng(1)
    for rate in (0.02, 0.3):
        found = [rate_interval(100.0 * (rng.random(100) < rate)) for _ in range(2000)]
        assert np.mean([each.low <= 100 * rate <= each.high for each in found]) == pytest.approx(0.95, abs=0.025)


def test_newcombe_s_interval_and_mcnemar_s_test_of_published_tables() -> None:
    # Bentur et al. (2009), in Fagerland, Lydersen and Laake (2014): airway hyper-responsiveness of 21 children.
    found = rate_difference(*pairs(1, 1, 7, 12))
    assert found is not None
    change, p_value = found
    ends = (change.mean / 100, change.low / 100, change.high / 100)
    assert ends == (pytest.approx(0.286, abs=5e-4), pytest.approx(0.026, abs=5e-4), pytest.approx(0.507, abs=5e-4))
    assert p_value == pytest.approx(18 / 256)
    # Five pairs differ, all in one way (Altman et al. 2000, table 6.2).
    altman = rate_difference(*pairs(14, 5, 0, 22))
    assert altman is not None
    assert altman[1] == pytest.approx(2 / 32)
    assert (altman[0].low, altman[0].high) == (pytest.approx(-22.65, abs=0.01), pytest.approx(-1.15, abs=0.01))


FLAGS = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=14)


@given(FLAGS)
def test_mcnemar_s_test_is_the_sign_flip_test_of_yes_and_no(values: list[tuple[bool, bool]]) -> None:
    before, after = 100.0 * np.array(values).T
    found = rate_difference(before, after)
    assert found is not None
    change, p_value = found
    assert p_value == pytest.approx(sign_flip_p_value(after - before))
    assert change.low <= change.mean <= change.high
    back = rate_difference(after, before)
    assert back is not None
    assert (back[0].low, back[0].high) == (pytest.approx(-change.high), pytest.approx(-change.low))


def test_intervals_of_differences_cover() -> None:
    rng = np.random.default_rng(2)
    covered = []
    for _ in range(2000):
        shared = rng.random(60)
        before, after = 100.0 * (shared < 0.4), 100.0 * (np.where(rng.random(60) < 0.3, rng.random(60), shared) < 0.25)
        found = rate_difference(before, after)
        assert found is not None
        covered.append(found[0].low <= -15.0 <= found[0].high)
    assert np.mean(covered) == pytest.approx(0.95, abs=0.025)


def test_shares_are_no_yes_or_no() -> None:
    assert rate_difference(np.array([50.0, 100.0]), np.array([0.0, 100.0])) is None


def test_a_rate_can_have_enough_seeds_for_any_number_of_comparisons() -> None:
    assert smallest_p_value(30, is_rate=True) == 2.0**-29 < smallest_p_value(30)
    assert seeds_needed(10**6) is None
    assert seeds_needed(10**6, is_rate=True) == 26


def with_crashes(crashes: Sequence[Sequence[bool]], conditions: Sequence[Condition]) -> list[CellResult]:
    """Results with a crash or none in each condition (C) with each seed (S)."""
    return [
        CellResult(Cell("late_fusion", condition, seed), {"crash": 100.0 * crashed, "sAMOTA": float(seed)})
        for condition, row in zip(conditions, crashes, strict=True)
        for seed, crashed in enumerate(row)
    ]


ONE, TWO = (Condition(),), (Condition(), Condition(latency_s=0.3))


def test_compare_tests_crashes_by_mcnemar_and_corrects_them() -> None:
    # Of 20 seeds B avoids 8 crashes and makes 1.
    before, after = [False, *[True] * 12, *[False] * 7], [True, *[False] * 8, *[True] * 4, *[False] * 7]
    compared = compare_results(with_crashes([before], ONE), with_crashes([after], ONE), ["crash"])
    (row,) = compared.differences
    assert row.is_rate
    assert (row.before, row.after, row.change.mean) == (60.0, 25.0, -35.0)
    assert row.p_value == pytest.approx(2 * 10 / 2**9)  # at most 1 of 9 coins
    assert row.p_corrected == row.p_value <= 0.05
    assert row.verdict == "better"
    assert "McNemar" in to_text(compared) and "bootstrap" not in to_text(compared)
    assert to_dict(compared)["differences"][0]["p_bootstrap"] is None


def test_two_conditions_are_tested_by_mcnemar_and_their_mean_by_flips() -> None:
    before, after = [[True] * 10, [True] * 10], [[False] * 10, [False] * 6 + [True] * 4]
    compared = compare_results(with_crashes(before, TWO), with_crashes(after, TWO), ["crash"])
    whole, first, second = compared.differences
    assert [row.is_rate for row in (whole, first, second)] == [False, True, True]
    assert (first.p_value, second.p_value) == (pytest.approx(2.0**-9), pytest.approx(2.0**-5))
    expected = holm(np.array([whole.p_value, first.p_value, second.p_value]))
    np.testing.assert_allclose([row.p_corrected for row in compared.differences], expected)


def test_equal_crashes_are_identical_and_no_comparison() -> None:
    same = with_crashes([[True, False] * 5], ONE)
    compared = compare_results(same, same, ["crash"])
    assert compared.differences[0].verdict == "identical"
    assert compared.compared == 0


def test_crashes_are_compared_by_default_where_there_are_any() -> None:
    some = with_crashes([[True, False] * 5], ONE)
    assert {row.metric for row in compare_results(some, some).differences} == {"sAMOTA", "crash"}
    none = results()
    assert {row.metric for row in compare_results(none, none).differences} == set(DEFAULT_METRICS) - {"crash"}


def test_tables_show_crash_rates_with_wilson_s_interval() -> None:
    table = ResultTable.of(with_crashes([[False] * 20], ONE))
    text = to_markdown(table, "safety")
    assert "0.0 (0.0 to 16.1)" in text
    assert "Wilson" in text
    (entry,) = standings(table, "crash")
    assert entry.mean.high == pytest.approx(16.11, abs=0.01)
    latex = "".join(latex_tables(table, ["crash"]).values())
    assert "(0.0 to 16.1)" in latex and "Wilson" in latex
    ordinary = to_markdown(ResultTable.of(results()), "tracking")
    assert "Wilson" not in ordinary and "crash" not in ordinary


def test_of_one_policy_that_never_crashes_the_ends_are_known() -> None:
    table = ResultTable.of(with_crashes([[False]], ONE))
    assert not math.isnan(table.interval("crash", table.values("crash")[0, 0]).high)
