"""The answers in words: all parts that the results have data for, with bounds marked."""

from __future__ import annotations

from coopsim.bench.grid.cell import Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.safety_plots import crash_plots
from coopsim.bench.safety.safety_text import matrix_html, to_safety_markdown
from tests.helpers.crashes import RATES, crash_results

LATE = [Condition(name, latency_s=each) for name in ("crossing", "merge") for each in (0.0, 0.3)]


def test_every_question_has_its_table() -> None:
    table = ResultTable.of(crash_results(conditions=LATE, AMOTA=lambda policy: -float(RATES[policy])))
    text = to_safety_markdown(table)
    rows = [" ".join(line.split()) for line in text.splitlines()]
    assert "| late_fusion | all situations | 20 | 50 % | 20 % | 6 | 0 | -30.0 (-49.1 to -6.7) | 0.34 |" in rows
    assert "| coop_fuse | +1.00 (+1.00 to +1.00) |" in rows and "| late_fusion | +0.00 (+0.00 to +0.00) |" in rows
    assert "| no_fusion | 0 | 50 % (30 to 70) |" in rows
    assert any(row.startswith("| AMOTA | -1.00 | -1.00 to ") for row in rows)
    assert any(row.startswith("| late_fusion |") and row.endswith("| not in these |") for row in rows)
    assert "truth (upper bound)" in text and "### latency" in text


def test_without_a_policy_that_sends_nothing_only_rates_are_told() -> None:
    loud = [each for each in crash_results(conditions=LATE) if each.cell.policy != "no_fusion"]
    text = to_safety_markdown(ResultTable.of(loud))
    assert "## Crash rates" in text and "## What messages change" not in text and "Where the gain" not in text


def test_figures_and_matrix_have_every_policy() -> None:
    table = ResultTable.of(crash_results(conditions=LATE))
    plots = crash_plots(table)
    assert set(plots) == {"crash_over_latency.svg", "crash_over_bytes.svg"}
    assert all("coop_fuse" in svg and "truth (upper bound)" in svg for svg in plots.values())
    page = matrix_html(table)
    assert "all situations" in page and "20 % <span" in page
