"""The choice of pairs: one of the two crashed, none is an upper bound, and they differ from each other."""

from __future__ import annotations

import pytest

from coopsim.bench.films.crash_pairs import find_pair, telling_pairs
from coopsim.bench.grid.cell import Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import InvalidValueError
from tests.helpers.crashes import crash_results


def test_one_run_of_a_pair_crashed_and_no_bound_is_in_it() -> None:
    pairs = telling_pairs(ResultTable.of(crash_results()), 10)
    assert len(pairs) == 6, "of the five seeds that crash alone, three are avoided by some policy, in two situations"
    for pair in pairs:
        assert pair.alone.cell.policy == "no_fusion" and pair.sharing.cell.policy != "truth"
        assert (pair.alone.cell.condition, pair.alone.cell.seed) == (
            pair.sharing.cell.condition,
            pair.sharing.cell.seed,
        )
        assert pair.avoided and not pair.sharing.values["crash"]
    assert len({(pair.sharing.cell.condition.scenario, pair.sharing.cell.seed) for pair in pairs}) == len(pairs)


def test_an_event_is_shown_once_whatever_the_policy_and_the_disturbance() -> None:
    late = [Condition("crossing", latency_s=each) for each in (0.0, 0.2)]
    pairs = telling_pairs(
        ResultTable.of(crash_results(lambda name, _, seed: name == "no_fusion" and not seed, late)), 5
    )
    assert [pair.alone.cell.seed for pair in pairs] == [0]


def test_pairs_are_varied_and_harm_is_among_them() -> None:
    def crashes(policy: str, condition: Condition, seed: int) -> bool:
        return seed < 5 if policy == "no_fusion" else policy == "coop_fuse" and seed == 7

    pairs = telling_pairs(ResultTable.of(crash_results(crashes)), 4)
    assert {pair.avoided for pair in pairs} == {True, False}
    assert len({pair.sharing.cell.policy for pair in pairs}) > 1
    assert len({pair.sharing.cell.condition for pair in pairs}) == 2
    assert len({pair.sharing.cell.seed for pair in pairs}) > 1


def test_without_a_policy_that_sends_nothing_there_are_no_pairs() -> None:
    loud = [each for each in crash_results() if each.cell.policy != "no_fusion"]
    assert telling_pairs(ResultTable.of(loud), 10) == ()
    with pytest.raises(InvalidValueError, match="must have a policy that sends nothing"):
        find_pair(ResultTable.of(loud), 1)
