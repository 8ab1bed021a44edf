"""Which policies are as good as the best: one that always falls behind is not, one that only sometimes does is."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from synthetic_results import LATENCIES, failed, results

from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import compare_with_best
from coopsim.bench.results.statistics import LEVEL, largest_difference_p_values
from coopsim.errors import UnknownNameError

SEEDS = tuple(range(8))
TABLE = ResultTable.of(results({"good": 60.0, "twin": 60.0, "bad": 30.0}, seeds=SEEDS))
EVERY = range(len(TABLE.conditions))


def test_the_best_is_better_than_what_always_falls_behind_and_not_than_its_twin() -> None:
    bad, good, twin = compare_with_best(TABLE, "sAMOTA", EVERY)
    assert [each.best for each in (bad, good, twin)].count(True) == 1
    best, other = (good, twin) if good.best else (twin, good)
    assert np.isnan(best.p_corrected) and not best.unbeaten
    assert other.unbeaten and other.p_corrected > 0.05
    assert not bad.unbeaten and bad.p_corrected <= 0.05


def test_p_values_are_the_share_of_flips_in_which_any_two_are_as_far_apart() -> None:
    entries = compare_with_best(TABLE, "sAMOTA", EVERY)
    by_seed = TABLE.values("sAMOTA").mean(axis=1)
    best = next(k for k, entry in enumerate(entries) if entry.best)

    def t(differences: NDArray[np.float64]) -> float:
        return abs(float(stats.ttest_1samp(differences, 0).statistic))

    # One flip and one pair after another, by Student's t.
    largest = [
        max(t((by_seed[a] - by_seed[b]) * signs) for a, b in itertools.combinations(range(3), 2))
        for signs in itertools.product([1, -1], repeat=len(SEEDS))
    ]
    for k in set(range(3)) - {best}:
        reached = np.mean(np.array(largest) >= t(by_seed[best] - by_seed[k]) * (1 - 1e-9))
        assert entries[k].p_corrected == pytest.approx(reached)


@pytest.mark.parametrize(
    ("policies", "seeds", "runs"),
    [(6, 10, 300), *(pytest.param(*each, marks=pytest.mark.long) for each in ((29, 12, 150), (29, 20, 60)))],
)
def test_of_equal_policies_one_is_called_worse_in_one_of_twenty_tables_at_most(
    policies: int, seeds: int, runs: int
) -> None:
    rng, wrong = np.random.default_rng([policies, seeds]), 0
    for _ in range(runs):
        values = rng.normal(size=(policies, seeds))
        wrong += largest_difference_p_values(values, int(values.mean(axis=1).argmax())).min() <= LEVEL
    assert wrong / runs <= LEVEL + 2 * math.sqrt(LEVEL * (1 - LEVEL) / runs)


def test_a_table_of_many_policies_finds_what_is_clearly_worse_and_twins_are_as_good() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(29, 12)) - np.where(np.arange(29) < 14, 0, 6)[:, None]
    values[1] = values[0]
    best = int(values.mean(axis=1).argmax())
    p_values = largest_difference_p_values(values, best)
    assert (p_values[14:] <= LEVEL).all() and (p_values[:14] > LEVEL).all()
    assert p_values[best] == 1 and (largest_difference_p_values(values, 0)[:2] == 1).all()
    np.testing.assert_array_equal(largest_difference_p_values(8 * values, best), p_values)


def test_less_may_be_better_and_conditions_are_chosen() -> None:
    bad, *_ = compare_with_best(TABLE, "IDS", EVERY)  # 100 - sAMOTA
    assert not bad.best and bad.p_corrected <= 0.05
    late = compare_with_best(TABLE, "sAMOTA", [len(LATENCIES) - 1])
    assert [entry.interval.mean for entry in late] == list(TABLE.values("sAMOTA")[:, -1].mean(axis=1))
    with pytest.raises(UnknownNameError, match="metric"):
        compare_with_best(TABLE, "nothing", EVERY)


def test_what_lacks_runs_is_compared_with_nobody() -> None:
    given = results({"good": 60.0, "middling": 50.0, "bad": 30.0}, seeds=SEEDS)
    lacking = [each for each in given if each.cell.policy != "good" or each.cell.seed != 3]
    lacking += [failed(each.cell) for each in given if each.cell.policy == "good" and each.cell.seed == 3]
    bad, good, middling = compare_with_best(ResultTable.of(lacking), "sAMOTA", EVERY)
    assert not good.complete and not good.best and np.isnan(good.p_corrected) and good.interval.count == 7
    assert middling.best and bad.complete and not bad.unbeaten
    nothing = compare_with_best(ResultTable.of([each for each in lacking if each.failed] + given[:1]), "sAMOTA", EVERY)
    assert not any(entry.best for entry in nothing if not entry.complete)


def test_with_few_seeds_nothing_is_beaten() -> None:
    bad, good, _ = compare_with_best(ResultTable.of(results(seeds=(0, 1, 2))), "sAMOTA", EVERY)
    assert good.best and bad.unbeaten
