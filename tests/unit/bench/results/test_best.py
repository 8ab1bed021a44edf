"""Which policies are as good as the best: one that always falls behind is not, one that only sometimes does is."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_results import LATENCIES, failed, results

from coopsim.bench.results.best import beside_best
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import bootstrap_difference, holm, sign_flip_p_value
from coopsim.errors import UnknownNameError

SEEDS = tuple(range(8))
TABLE = ResultTable.of(results({"good": 60.0, "twin": 60.0, "bad": 30.0}, seeds=SEEDS))
EVERY = range(len(TABLE.conditions))


def test_the_best_is_better_than_what_always_falls_behind_and_not_than_its_twin() -> None:
    bad, good, twin = beside_best(TABLE, "sAMOTA", EVERY)
    assert [each.best for each in (bad, good, twin)].count(True) == 1
    best, other = (good, twin) if good.best else (twin, good)
    assert np.isnan(best.p_corrected) and not best.unbeaten
    assert other.unbeaten and other.p_corrected > 0.05
    assert not bad.unbeaten and bad.p_corrected <= 0.05


def test_p_values_are_those_of_paired_differences_corrected_for_the_policies() -> None:
    entries = beside_best(TABLE, "sAMOTA", EVERY)
    by_seed = TABLE.values("sAMOTA").mean(axis=1)
    best = next(k for k, entry in enumerate(entries) if entry.best)
    others = [k for k in range(3) if k != best]
    raw = [
        max(bootstrap_difference(by_seed[best] - by_seed[k])[1], sign_flip_p_value(by_seed[best] - by_seed[k]))
        for k in others
    ]
    assert [entries[k].p_corrected for k in others] == list(holm(np.array(raw)))


def test_less_may_be_better_and_conditions_are_chosen() -> None:
    bad, *_ = beside_best(TABLE, "IDS", EVERY)  # 100 - sAMOTA
    assert not bad.best and bad.p_corrected <= 0.05
    late = beside_best(TABLE, "sAMOTA", [len(LATENCIES) - 1])
    assert [entry.interval.mean for entry in late] == list(TABLE.values("sAMOTA")[:, -1].mean(axis=1))
    with pytest.raises(UnknownNameError, match="metric"):
        beside_best(TABLE, "nothing", EVERY)


def test_what_lacks_runs_is_compared_with_nobody() -> None:
    given = results({"good": 60.0, "middling": 50.0, "bad": 30.0}, seeds=SEEDS)
    lacking = [each for each in given if each.cell.policy != "good" or each.cell.seed != 3]
    lacking += [failed(each.cell) for each in given if each.cell.policy == "good" and each.cell.seed == 3]
    bad, good, middling = beside_best(ResultTable.of(lacking), "sAMOTA", EVERY)
    assert not good.complete and not good.best and np.isnan(good.p_corrected) and good.interval.count == 7
    assert middling.best and bad.complete and not bad.unbeaten
    nothing = beside_best(ResultTable.of([each for each in lacking if each.failed] + given[:1]), "sAMOTA", EVERY)
    assert not any(entry.best for entry in nothing if not entry.complete)


def test_with_few_seeds_nothing_is_beaten() -> None:
    bad, good, _ = beside_best(ResultTable.of(results(seeds=(0, 1, 2))), "sAMOTA", EVERY)
    assert good.best and bad.unbeaten
