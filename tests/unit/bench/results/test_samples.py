"""What the values of a benchmark are samples of."""

from dataclasses import replace

import numpy as np
from synthetic_results import FRAMES, failed, results

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.results.comparison import compare_results
from coopsim.bench.results.result_table import ResultTable, Samples, samples_of
from coopsim.bench.results.standings import standings
from coopsim.bench.results.statistics import mean_interval

TOWN, CROSSING = Condition("town"), Condition("crossing")


def ran(condition: Condition, *places: int | None) -> list[CellResult]:
    """A run with each seed, in these places."""
    return [CellResult(Cell("a", condition, seed), {"HOTA": 1.0}, place_seed=p) for seed, p in enumerate(places)]


def of(*results: CellResult) -> Samples:
    return samples_of(results, sorted({each.cell.seed for each in results}))


def test_seeds_are_the_samples_where_no_place_is_drawn() -> None:
    samples = of(*ran(CROSSING, None, None))
    assert samples.text == "2 seeds" and samples.group.tolist() == [0, 1] and not samples.are_places


def test_each_place_is_one_sample() -> None:
    assert of(*ran(TOWN, 4, 5, 6)).text == "3 places"
    shared = of(*ran(TOWN, 4, 5, 4, 5, 6))
    assert shared.text == "3 places" and shared.group.tolist() == [0, 1, 0, 1, 2]
    np.testing.assert_array_equal(shared.average(np.array([1.0, 2.0, 3.0, np.nan, 5.0])), [2.0, 2.0, 5.0])


def test_one_place_that_is_held() -> None:
    held = of(*ran(TOWN, 4, 4, 4))
    assert held.text == "3 seeds in one place" and held.group.tolist() == [0, 1, 2]
    assert of(*ran(TOWN, 4)).text == "one place"


def test_towns_next_to_other_scenarios() -> None:
    assert of(*ran(TOWN, 4, 5), *ran(CROSSING, None, None)).text == "2 seeds"
    assert of(*ran(TOWN, 4, 4), *ran(CROSSING, None, None)).text == "2 seeds"
    mixed = of(*ran(TOWN, 4, 5, 4), *ran(CROSSING, None, None, None))
    assert mixed.group.tolist() == [0, 1, 0], "two seeds share a town, so they are alike"


def test_two_sets_of_places_are_told_apart() -> None:
    train, test = Condition("train.yaml"), Condition("test.yaml")
    samples = of(*ran(train, 0, 1, 2), *ran(test, 10, 11, 12))
    assert samples.text == "3 seeds, 6 places" and samples.counted(2) == "2 seeds"
    assert of(*ran(train, 0, 1, 2), *ran(test, 0, 1, 2)).text == "3 places"
    shared = of(*ran(train, 0, 1, 0), *ran(test, 10, 11, 12))
    assert shared.text == "2 samples, 5 places" and shared.group.tolist() == [0, 1, 0]


def test_runs_in_other_places_are_not_compared() -> None:
    before, after = ran(TOWN, 4, 5, 6), ran(TOWN, 4, 7, None)
    comparison = compare_results(before, after, ["HOTA"])
    assert comparison.matched == 1 and len(comparison.unmatched) == 2
    assert comparison.unmatched[0].endswith(": in place 5 in A but in place 7 in B")
    assert comparison.unmatched[1].endswith(": in place 6 in A but in no drawn place in B")


def test_failed_cells_tell_nothing() -> None:
    assert of(*ran(TOWN, 4, 5), failed(Cell("b", TOWN, 1))).text == "2 places"


def test_intervals_and_differences_are_over_places() -> None:
    seeds = range(6)
    drawn = [replace(each, place_seed=each.cell.seed % 3) for each in results(seeds=seeds)]
    table = ResultTable.of(drawn)
    (best, *_) = standings(table, "HOTA")
    values = table.values("HOTA")[table.policies.index(best.policy)].mean(axis=0)
    assert best.mean == mean_interval(values.reshape(2, 3).mean(axis=0)) and best.mean.count == 3
    after = [replace(each, values={**each.values, "HOTA": each.values["HOTA"] + each.cell.seed}) for each in drawn]
    comparison = compare_results(drawn, after, ["HOTA"])
    assert {row.change.count for row in comparison.differences} == {3} and comparison.samples.text == "3 places"
    np.testing.assert_allclose([row.change.mean for row in comparison.differences], 2.5)
    assert table.frames == FRAMES
