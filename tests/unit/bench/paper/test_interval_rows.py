"""Means with intervals and significance as CSV."""

from __future__ import annotations

import csv
import io

import numpy as np
from synthetic_results import EFFECTS, LATENCIES, results

from coopsim.bench.paper.tables import interval_csv
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import compare_with_best
from coopsim.bench.results.statistics import mean_interval

TABLE = ResultTable.of(results(seeds=range(8)))


def test_a_row_for_each_policy_metric_and_condition_and_for_all() -> None:
    rows = list(csv.DictReader(io.StringIO(interval_csv(TABLE, ["sAMOTA", "HOTA"]))))
    assert len(rows) == len(EFFECTS) * 2 * (len(LATENCIES) + 1)
    (row,) = (
        each
        for each in rows
        if (each["policy"], each["metric"], each["latency_s"], each["scenario"]) == ("bad", "HOTA", "0.5", "crossing")
    )
    interval = mean_interval(TABLE.values("HOTA")[TABLE.policies.index("bad"), 2])
    assert [float(row[name]) for name in ("mean", "low", "high")] == [interval.mean, interval.low, interval.high]
    assert (row["samples"], row["complete"], row["best"]) == ("8", "True", "False")
    assert float(row["p_to_best"]) == compare_with_best(TABLE, "HOTA", [2])[TABLE.policies.index("bad")].p_corrected
    everywhere = [each for each in rows if not each["scenario"] and each["metric"] == "sAMOTA"]
    assert [each["policy"] for each in everywhere] == sorted(EFFECTS)
    means = TABLE.values("sAMOTA").mean(axis=(1, 2))
    np.testing.assert_allclose([float(each["mean"]) for each in everywhere], means)
    assert [each["p_to_best"] == "" for each in everywhere] == [each["best"] == "True" for each in everywhere]


def test_one_condition_needs_no_rows_for_all_and_one_seed_has_no_interval() -> None:
    table = ResultTable.of(results(conditions=LATENCIES[:1], seeds=(0,)))
    rows = list(csv.DictReader(io.StringIO(interval_csv(table, ["sAMOTA"]))))
    assert len(rows) == len(EFFECTS) and {each["scenario"] for each in rows} == {"crossing"}
    assert {(each["low"], each["high"], each["samples"]) for each in rows} == {("", "", "1")}
