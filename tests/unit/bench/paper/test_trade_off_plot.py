"""The figure of a metric over bytes: every method is there, and the front has those that none beats in both."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_results import results

from coopsim.bench.grid.cell import Cell
from coopsim.bench.paper.trade_off_plot import pareto_front, trade_off
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import UnknownNameError

SENDS = {"silent": "none", "boxes(x=1)": "detections", "maps <b>": "features", "_odd": "something"}
TABLE = ResultTable.of(results({"silent": 30.0, "boxes(x=1)": 50.0, "maps <b>": 60.0, "_odd": 40.0}))


def test_every_policy_has_a_label_and_what_it_sends_is_told_once() -> None:
    text = trade_off(TABLE, "sAMOTA", SENDS)
    words = re.findall(r">([^<>]+)</text>", text)
    assert {"silent", "boxes", "maps &lt;b&gt;", "_odd"} <= set(words)
    assert {"sends nothing", "sends features", "Pareto front", "sAMOTA", "0"} <= set(words) and "points" not in words
    assert words.count("features") == 1 and text == trade_off(TABLE, "sAMOTA", SENDS)
    with pytest.raises(UnknownNameError, match="metric"):
        trade_off(TABLE, "nothing", SENDS)


def test_it_is_drawn_of_whatever_there_is() -> None:
    none = [replace(each, values={"sAMOTA": np.nan, "bytes_per_s": 1.0}) for each in results()]
    silent = [replace(each, values={"sAMOTA": 5.0, "bytes_per_s": 0.0}) for each in results(seeds=(0,))]
    for given_results in (none, silent, results()[:1]):
        assert "</svg>" in trade_off(ResultTable.of(given_results), "sAMOTA", {})


def test_what_is_far_from_the_others_stands_at_the_edge_with_its_number() -> None:
    def words(names: str) -> list[str]:
        scores = {"a": 31.0, "b": 32.0, "c": 33.0, "d": 34.0, "e": 37.0, "far": 500.0}
        table = ResultTable.of(results({name: scores[name] for name in names.split()}))
        return re.findall(r">([^<>\n]+)</text>", trade_off(table, "sAMOTA", {}))

    far = re.compile("far: (49|50)[0-9]")
    many, few = words("a b c d e far"), words("a b far")
    assert {"a", "b", "c", "d", "e"} <= set(many) and [each for each in many if far.fullmatch(each)]
    assert not {"200", "300", "400"} & set(many), "the axis would reach up to it"
    assert "far" in few, "of three values none is far"


def test_what_the_whiskers_of_others_reach_stands_where_it_is() -> None:
    def labels(swing: float) -> list[str]:
        scores = {"a": 70.0, "b": 71.0, "c": 71.5, "d": 72.0, "e": 72.5, "low": 60.0}
        given = [
            replace(each, values={**each.values, "sAMOTA": scores[each.cell.policy] + _swing(each.cell, swing)})
            for each in results(scores, seeds=range(4))
        ]
        return re.findall(r">(low[^<>\n]*)</text>", trade_off(ResultTable.of(given), "sAMOTA", {}))

    def _swing(cell: Cell, swing: float) -> float:
        return (swing if cell.seed % 2 else -swing) * (cell.policy == "a")

    assert labels(0.1) == ["low: 60"]
    assert labels(7.0) == ["low"], "the axis reaches it anyway, for the whisker of another"


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=12), st.booleans())
def test_the_front_has_what_none_beats_in_both(points: list[tuple[int, int]], less: bool) -> None:
    rates, values = zip(*points, strict=True)
    sign = 1 if less else -1
    costs = [(rate, sign * value) for rate, value in points]
    front = pareto_front(rates, values, less)

    def beaten(k: int) -> bool:
        return any(a <= costs[k][0] and b <= costs[k][1] and (a, b) != costs[k] for a, b in costs)

    assert {costs[k] for k in front} == {costs[k] for k in range(len(points)) if not beaten(k)}
    assert [rates[k] for k in front] == sorted({rates[k] for k in front})
