"""Results as arrays, what varies in them, and the standings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from synthetic_results import EFFECTS, FRAMES, LATENCIES, failed, result, results

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.labels import label, mildest, varying_axes
from coopsim.bench.report.bench_report import About, render_bench_report
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import compare_with_best, standings
from coopsim.bench.text.bench_text import to_markdown
from coopsim.errors import InvalidValueError, UnknownNameError


def test_order_of_results_does_not_matter() -> None:
    given = results()
    forth, back = ResultTable.of(given), ResultTable.of(given[::-1])
    assert forth.policies == back.policies == ("bad", "good", "middling") and forth.seeds == (0, 1, 2)
    assert forth.metrics == ("sAMOTA", "HOTA", "IDS", "bytes_per_s", "XYZ")
    assert forth.shown == ("sAMOTA", "HOTA", "IDS")
    np.testing.assert_array_equal(forth.values("HOTA"), back.values("HOTA"))
    for each in given:
        place = forth.places[forth.results.index(each)]
        assert forth.values("sAMOTA")[place] == each.values["sAMOTA"]
    assert forth.finished.all() and forth.missing == 0 and forth.failures == ()


def test_failed_and_missing_cells_are_told_apart() -> None:
    given = results()
    cell = given[4].cell
    table = ResultTable.of([*given[1:4], failed(cell), *given[5:]])
    assert [each.cell for each in table.failures] == [cell] and table.missing == 1
    assert (~table.finished).sum() == np.isnan(table.values("sAMOTA")).sum() == 2


def test_a_table_of_metrics_of_one_s_own() -> None:
    cell = Cell("a", Condition(), 0, FRAMES)
    table = ResultTable.of([replace(result(cell, 50), values={"mine": 1.0})])
    assert table.shown == table.metrics == ("mine",)
    with pytest.raises(UnknownNameError, match=r"unknown metric 'mien'. Did you mean 'mine'"):
        table.values("mien")


def test_networks_of_several_arithmetics_in_one_table_are_told() -> None:
    given = results()
    one = [replace(each, arithmetic="float32") for each in given]
    two = [*one[:-1], replace(given[-1], arithmetic="bfloat16")]
    assert ResultTable.of(given).caution == ResultTable.of(one).caution == ""
    said = "Networks multiplied in bfloat16 and float32"
    assert said in to_markdown(ResultTable.of(two), "x") and said not in to_markdown(ResultTable.of(one), "x")
    assert said in render_bench_report(ResultTable.of(two), About())


def test_what_no_mean_should_mix_is_refused() -> None:
    given = results()
    other = replace(given[0], cell=replace(given[0].cell, frames=7))
    with pytest.raises(InvalidValueError, match=rf"one length, got \[7, {FRAMES}\] frames"):
        ResultTable.of([*given, other])
    with pytest.raises(InvalidValueError, match="got two of Cell"):
        ResultTable.of([*given, given[3]])
    with pytest.raises(InvalidValueError, match="there are no results: run a benchmark first"):
        ResultTable.of([])


def test_only_what_varies_is_named() -> None:
    assert [axis.title for axis in varying_axes(LATENCIES)] == ["latency"]
    assert label(LATENCIES[1], LATENCIES) == "latency 100 ms"
    one = (Condition("highway"),)
    assert varying_axes(one) == () and label(one[0], one) == "highway" and mildest(one) == one
    two = (Condition("a", bandwidth_bit_s=6e6), Condition("b"))
    assert label(two[0], two) == "a, bandwidth 6 Mbit/s" and label(two[1], two) == "b, bandwidth no limit"
    assert mildest(two) == (two[1],)
    assert label(Condition(loss=0.07), (Condition(loss=0.07), Condition())) == "loss 7 %"


def test_what_varies_only_together_is_one_axis() -> None:
    pose = [Condition(position_noise_m=step, heading_noise_deg=2 * step) for step in (0.0, 0.5, 1.0)]
    (axis,) = varying_axes(pose)
    assert axis.title == "position noise and heading noise" and axis.label == "position noise (m), with heading noise"
    assert label(pose[1], pose) == "position noise and heading noise 0.5 m and 1 °" and mildest(pose) == (pose[0],)
    product = [*pose, Condition(position_noise_m=1.0)]
    assert [axis.title for axis in varying_axes(product)] == ["position noise", "heading noise"]
    # The mildest of everything need not be among the conditions.
    assert mildest((Condition(latency_s=0.1), Condition(loss=0.1), Condition(latency_s=0.1, loss=0.1))) == ()


def test_standings_are_means_over_conditions_with_the_worst_one() -> None:
    table = ResultTable.of(results())
    ranked = standings(table, "sAMOTA")
    assert [(entry.policy, entry.rank) for entry in ranked] == [("good", 1), ("middling", 2), ("bad", 3)]
    for entry in ranked:
        values = table.values("sAMOTA")[table.policies.index(entry.policy)]
        by_condition = values.mean(axis=1)
        assert entry.mean.mean == pytest.approx(values.mean()) and entry.mean.count == 3
        assert entry.worst == pytest.approx(by_condition.min())
        assert entry.worst_condition == table.conditions[by_condition.argmin()]
        assert entry.undisturbed == pytest.approx(by_condition[0])
        assert entry.bytes_per_s == pytest.approx(50 * EFFECTS[entry.policy] - 1500)
    less = standings(table, "IDS")
    assert [entry.policy for entry in less] == ["good", "middling", "bad"], "less is better"
    assert less[0].worst > less[0].mean.mean


def test_who_lacks_a_cell_has_no_rank_and_never_wins_by_it() -> None:
    given = [each for each in results() if each.cell.policy != "good"]
    # The best policy failed where it is hard, which would make its mean better still.
    for condition in LATENCIES:
        for seed in range(3):
            cell = Cell("good", condition, seed, FRAMES)
            given.append(failed(cell) if condition.latency_s == 0.5 and seed < 2 else result(cell, 60.0))
    ranked = standings(ResultTable.of(given[:-1]), "sAMOTA")
    assert [(entry.policy, entry.rank, entry.failed, entry.missing) for entry in ranked] == [
        ("middling", 1, 0, 0),
        ("bad", 2, 0, 0),
        ("good", None, 2, 1),
    ]


def test_no_value_at_all() -> None:
    cells = [Cell("a", condition, 0, FRAMES) for condition in LATENCIES]
    table = ResultTable.of([result(cell, 50.0, sAMOTA=math.nan) for cell in cells])
    (entry,) = standings(table, "sAMOTA")
    assert entry.rank is None and entry.worst_condition is None and math.isnan(entry.mean.mean) and entry.failed == 0


def test_equals_share_a_rank() -> None:
    cells = [Cell(policy, LATENCIES[0], 0, FRAMES) for policy in "abc"]
    table = ResultTable.of(
        [result(cell, 50.0, sAMOTA=value) for cell, value in zip(cells, (1.0, 2.0, 2.0), strict=True)]
    )
    assert [(entry.policy, entry.rank) for entry in standings(table, "sAMOTA")] == [("b", 1), ("c", 1), ("a", 3)]


def without(values: tuple[str, ...], seed: int) -> list[CellResult]:
    """Results in which some policies have no sAMOTA with a seed."""
    return [
        replace(each, values={**each.values, "sAMOTA": math.nan})
        if each.cell.seed == seed and each.cell.policy in values
        else each
        for each in results()
    ]


def test_a_seed_in_which_nobody_has_a_value_is_left_out_for_all_alike() -> None:
    table = ResultTable.of(without(tuple(EFFECTS), 1))
    assert table.whole("sAMOTA").all()
    ranked = standings(table, "sAMOTA")
    assert [entry.rank for entry in ranked] == [1, 2, 3] and ranked[0].mean.count == 2
    assert [each.complete for each in compare_with_best(table, "sAMOTA", range(3))] == [True] * 3
    assert not math.isnan(compare_with_best(table, "sAMOTA", range(3))[0].p_corrected)


def test_a_policy_that_lacks_what_another_has_is_not_ranked() -> None:
    table = ResultTable.of(without(("good",), 1))
    assert dict(zip(table.policies, table.whole("sAMOTA").tolist(), strict=True)) == {
        "bad": True, "good": False, "middling": True,
    }  # fmt: skip
    assert standings(table, "sAMOTA")[-1].rank is None
    assert (
        not ResultTable.of(without(tuple(EFFECTS), 1)[:1] + [failed(each.cell) for each in results()[1:]])
        .whole("sAMOTA")
        .any()
    )
