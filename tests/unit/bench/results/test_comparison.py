"""Two sides cell by cell: nothing is dropped in silence, and nothing is claimed that seeds cannot show."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from synthetic_results import LATENCIES, failed, results

from coopsim.bench.grid.cell import CellResult, Condition
from coopsim.bench.results.comparison import as_one_policy, compare_results
from coopsim.bench.results.statistics import LEVEL
from coopsim.bench.text.comparison_text import to_csv, to_dict, to_text
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.rng import stream


def changed(before: Sequence[CellResult], by: float, noise: float = 0.3) -> list[CellResult]:
    """The same with sAMOTA and IDS raised, by about as much in every cell."""
    after = []
    for each in before:
        own = by + stream(each.cell.seed, "change", str(each.cell)).normal(scale=noise)
        after.append(
            replace(
                each, values={**each.values, "sAMOTA": each.values["sAMOTA"] + own, "IDS": each.values["IDS"] + own}
            )
        )
    return after


TEN = results({"a": 50.0}, seeds=range(10))


def test_a_change_is_found_with_its_size_and_sign() -> None:
    comparison = compare_results(TEN, changed(TEN, 2.0), ["sAMOTA", "IDS"])
    assert comparison.matched == 30 and comparison.unmatched == ()
    assert [(row.metric, row.condition) for row in comparison.differences] == [
        (metric, condition) for metric in ("sAMOTA", "IDS") for condition in (None, *LATENCIES)
    ]
    for row in comparison.differences:
        assert row.significant and row.change.low < 2 < row.change.high and row.change.count == 10
        assert row.verdict == ("better" if row.metric == "sAMOTA" else "worse")
        assert row.after - row.before == pytest.approx(row.change.mean)
        assert row.p_corrected >= max(row.p_bootstrap, row.p_sign_flip)
    back = compare_results(changed(TEN, 2.0), TEN, ["sAMOTA", "IDS"])
    for row, other in zip(comparison.differences, back.differences, strict=True):
        assert other.change.mean == -row.change.mean and other.p_corrected == row.p_corrected
        assert {row.verdict, other.verdict} == {"better", "worse"}


def test_pairing_sees_what_means_hide() -> None:
    # Traffic differs by far more between seeds than the policies do.
    rough = [replace(each, values={"sAMOTA": 100.0 * each.cell.seed}) for each in TEN]
    after = [replace(each, values={"sAMOTA": each.values["sAMOTA"] + 1 + 0.1 * (each.cell.seed % 3)}) for each in rough]
    assert all(row.verdict == "better" for row in compare_results(rough, after).differences)


def test_where_nothing_differs_few_comparisons_say_so() -> None:
    wrong, families = 0, 40
    for family in range(families):
        seeds = range(10 * family, 10 * family + 10)
        before = results({"a": 50.0}, seeds=seeds)
        rows = compare_results(before, changed(before, 0.0, noise=3.0), ["sAMOTA", "IDS"]).differences
        wrong += any(row.significant for row in rows)
    assert wrong / families <= LEVEL + 3 * math.sqrt(LEVEL * (1 - LEVEL) / families)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_seeds_are_never_significant_and_it_says_why(count: int) -> None:
    before = results({"a": 50.0}, seeds=range(count))
    comparison = compare_results(before, changed(before, 40.0, noise=0.01))
    rows = [row for row in comparison.differences if row.metric == "sAMOTA"]
    assert all(row.verdict == "too few seeds" and not row.significant for row in rows)
    text = to_text(comparison)
    assert f"With {count} seed{'s' * (count > 1)} no p can be below {2 ** (1 - count):.3g}" in text
    assert "it takes 6 seeds for one comparison, 8 for 4 of them" in text, "HOTA is the same"
    assert "a, sAMOTA, over all conditions: too few seeds for 4 comparisons (8 needed) (B - A = +40" in text
    assert ("needs 4 seeds" in text) == (count < 4)
    assert all((row["low"] is None) == (count < 4) for row in to_dict(comparison)["differences"][:4])


def test_a_large_difference_that_so_many_comparisons_cannot_show_is_no_finding_of_none() -> None:
    # 13 comparisons need 10 seeds: each p is at least 13 / 2^7 = 0.102, however large the difference.
    conditions = [Condition(latency_s=k / 10) for k in range(7)]
    before = results({"a": 50.0}, conditions, seeds=range(8))
    after = changed(before, 19.7)
    for k, each in enumerate(after):
        if each.cell.condition.latency_s == 0:
            after[k] = replace(each, values=before[k].values)
    comparison = compare_results(before, after, ["sAMOTA", "IDS"])
    assert len(comparison.differences) == 16 and comparison.compared == 14
    for row in comparison.differences:
        same = row.condition is not None and row.condition.latency_s == 0
        assert row.verdict == ("identical" if same else "too few seeds")
        assert same or (row.change.low > 0 and row.p_possible == 14 / 2**7)
    text = to_text(comparison)
    assert "a, sAMOTA, over all conditions: too few seeds for 14 comparisons (10 needed)" in text
    assert "no significant difference" not in text and "14 comparisons (2 identical ones are not counted)" in text
    assert to_dict(comparison)["comparisons"] == 14 and to_dict(comparison)["seeds_needed"] == 10
    one = to_text(compare_results(before[8:13], after[8:13], ["sAMOTA"]))
    assert "too few seeds (6 needed)" in one and "it takes 6 seeds for one comparison." in one


def test_identical_rows_do_not_count_in_the_correction() -> None:
    whole, *each = compare_results(TEN, changed(TEN, 2.0), ["sAMOTA", "HOTA", "XYZ"]).differences
    alone = compare_results(TEN, changed(TEN, 2.0), ["sAMOTA"]).differences
    assert [row.p_corrected for row in (whole, *each[:3])] == [row.p_corrected for row in alone]
    assert all(row.identical and row.p_corrected == 1 for row in each[3:])


def test_an_interval_beside_0_that_the_correction_takes_away_is_told_as_such() -> None:
    rng, before = np.random.default_rng(2), results({"a": 50.0}, seeds=range(12))
    after = []
    for each in before:
        value = each.values["sAMOTA"] + 3 * each.cell.condition.latency_s + rng.normal(scale=1.3)
        after.append(replace(each, values={"sAMOTA": value}))
    comparison = compare_results(before, after, ["sAMOTA"])
    assert comparison.differences[0].change.low > 0 and comparison.differences[0].verdict == "not significant"
    assert "a, sAMOTA, over all conditions: not significant after correction for 4 comparisons" in to_text(comparison)


def test_the_same_twice() -> None:
    comparison = compare_results(TEN, TEN)
    assert {row.verdict for row in comparison.differences} == {"identical"}
    assert "A and B are identical" in to_text(comparison) and "seeds, 0 comparisons (8 identical" in to_text(comparison)


def test_what_has_no_partner_is_told() -> None:
    after = changed(TEN, 2.0)
    del after[29]  # seed 9 at 500 ms
    after[0] = failed(after[0].cell)
    after[11] = replace(after[11], values={**after[11].values, "sAMOTA": math.nan})
    after[20] = replace(after[20], cell=replace(after[20].cell, frames=7))
    comparison = compare_results(TEN, after, ["sAMOTA"])
    assert comparison.matched == 27
    faults = [line.rsplit(": ", 1) for line in comparison.unmatched]
    assert sorted(fault for _, fault in faults) == ["failed in B", "no sAMOTA in B", "not in A", "not in B", "not in B"]
    assert all("a, crossing, latency" in name and "seed" in name for name, _ in faults)
    whole, *each = comparison.differences
    assert [row.change.count for row in each] == [9, 9, 8] and whole.change.count == 7, "seeds that have all conditions"
    text = to_text(comparison)
    assert "Left out (5):" in text and all(line in text for line in comparison.unmatched)


def test_no_seed_with_all_conditions() -> None:
    odd = [each for each in TEN if (each.cell.seed % 2 == 0) == (each.cell.condition.latency_s > 0)]
    comparison = compare_results(odd, changed(odd, 2.0), ["sAMOTA"])
    assert [row.condition for row in comparison.differences] == list(LATENCIES)
    assert comparison.unmatched == ("a: no seed has sAMOTA in all conditions, so there is no row for all",)


def test_two_policies_of_one_benchmark() -> None:
    everything = results({"a": 40.0, "b": 60.0, "c": 50.0}, seeds=range(8))
    sides = [as_one_policy(everything, policy, "b - a") for policy in "ab"]
    comparison = compare_results(sides[0], sides[1], ["sAMOTA"])
    assert {row.policy for row in comparison.differences} == {"b - a"} and comparison.matched == 24
    assert comparison.differences[0].change.mean == pytest.approx(20, abs=1)
    with pytest.raises(UnknownNameError, match=r"unknown policy of the results 'd'"):
        as_one_policy(everything, "d", "")


def test_one_condition_has_no_row_for_all() -> None:
    before = results({"a": 50.0}, conditions=[Condition("highway")], seeds=range(9))
    comparison = compare_results(before, changed(before, 3.0), ["sAMOTA"])
    (row,) = comparison.differences
    assert row.condition == Condition("highway") and "a, sAMOTA, highway: B is better" in to_text(comparison)


def test_machines_get_every_number() -> None:
    comparison = compare_results(TEN, changed(TEN, 2.0))
    rows = list(csv.DictReader(io.StringIO(to_csv(comparison))))
    plain = json.loads(json.dumps(to_dict(comparison), allow_nan=False))
    assert len(rows) == len(plain["differences"]) == len(comparison.differences) == 8
    for text, number, row in zip(rows, plain["differences"], comparison.differences, strict=True):
        assert float(text["difference"]) == number["difference"] == row.change.mean
        assert float(text["p_corrected"]) == number["p_corrected"] == row.p_corrected
        assert (number["scenario"] is None) == (row.condition is None)
    assert plain["differences"][1]["bandwidth_bit_s"] is None, "infinite"


def test_the_same_results_in_any_order_give_the_same_text() -> None:
    after = changed(TEN, 0.2)
    assert to_text(compare_results(TEN, after)) == to_text(compare_results(TEN[::-1], after[::-1]))


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"no finished cell in common: a, crossing.*: not in B"):
        compare_results(TEN, results({"other": 1.0}))
    with pytest.raises(InvalidValueError, match=r"no finished cell in common$"):
        compare_results([], [])
    with pytest.raises(UnknownNameError, match=r"unknown metric 'sAMTA'. Did you mean 'sAMOTA'"):
        compare_results(TEN, TEN, ["sAMTA"])
    with pytest.raises(InvalidValueError, match=r"got two of a, crossing.*folders of their own"):
        compare_results([*TEN, TEN[0]], TEN)
    nothing = [replace(each, values={"sAMOTA": np.nan}) for each in TEN]
    with pytest.raises(InvalidValueError, match="no pair of runs has a value of sAMOTA"):
        compare_results(nothing, TEN, ["sAMOTA"])
    with pytest.raises(UnknownNameError, match=r"unknown metric 'sAMOTA'. Accepted: mine"):
        compare_results([replace(TEN[0], values={"mine": 1.0})], [replace(TEN[0], values={"mine": 1.0})])


def test_a_long_list_of_left_out_cells_is_cut_and_counted() -> None:
    text = to_text(compare_results(TEN, TEN[:15]))
    assert "Left out (15):" in text and "and 5 more, which --json lists" in text


def test_too_many_comparisons_for_any_number_of_seeds() -> None:
    conditions = [Condition(latency_s=k / 1000) for k in range(420)]
    many = results({"a": 50.0}, conditions=conditions, seeds=(0, 1))
    assert "So many comparisons leave nothing to be significant" in to_text(
        compare_results(many, changed(many, 1.0), ["sAMOTA", "IDS"])
    )
