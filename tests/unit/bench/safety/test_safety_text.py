"""The answers in words: all parts that the results have data for, with bounds marked."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest
from html_page import Page

from coopsim.bench.grid.cell import Condition
from coopsim.bench.paper.trade_off_plot import trade_off
from coopsim.bench.report.bench_plots import plots
from coopsim.bench.report.bench_report import About, render_bench_report
from coopsim.bench.report.crashes_page import crashes_section, matrix_html
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.safety_text import to_safety_markdown
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


def crash_plots(table: ResultTable) -> dict[str, str]:
    """Draw the figures of crash rates that a folder of results has."""
    return {**plots(table, "crash", together=True), "crash_over_bytes.svg": trade_off(table, "crash", {})}


def test_figures_and_matrix_have_every_policy() -> None:
    table = ResultTable.of(crash_results(conditions=LATE))
    plots = crash_plots(table)
    assert set(plots) == {"crash_over_latency.svg", "crash_over_bytes.svg"}
    assert all("coop_fuse" in svg and "truth (upper bound)" in svg for svg in plots.values())
    page = matrix_html(table)
    assert "all situations" in page and "20 % <span" in page


def test_ticks_are_words_that_people_read() -> None:
    svg = crash_plots(ResultTable.of(crash_results(conditions=LATE)))["crash_over_bytes.svg"]
    words = re.findall(r">([^<>\n]+)</text>", svg)
    assert "mathdefault" not in svg and {"0", "10 k", "100 k"} <= set(words)
    places = [float(x) for x in re.findall(r'id="xtick_\d+">.*?<use [^>]*x="([0-9.]+)"', svg, re.DOTALL)]
    assert len(places) >= 3 and min(b - a for a, b in pairwise(places)) > 30, "none on another"


@pytest.mark.parametrize(("rates", "top"), [({}, 80), ({"no_fusion": 1}, 50)])
def test_the_axis_ends_above_the_highest_whisker(rates: dict[str, int], top: int) -> None:
    counts = {**RATES, **rates} if not rates else {**dict.fromkeys(RATES, 0), **rates}
    given = crash_results(lambda policy, condition, seed: seed < counts[policy], conditions=LATE[::2])
    svg = crash_plots(ResultTable.of(given))["crash_over_bytes.svg"]
    ticks = [int(each) for each in re.findall(r">(\d+)</text>", svg)]
    assert max(ticks) <= top


ATTACKED = [Condition("merge", attacks=each) for each in ("", "cav_1=remove", "cav_1=ghost(ahead_m=15)")]


def test_attacks_are_names_on_an_axis() -> None:
    table = ResultTable.of(crash_results(conditions=ATTACKED, sAMOTA=lambda policy: 50.0 + len(policy)))
    for svg in (crash_plots(table)["crash_over_attacks.svg"], plots(table, "sAMOTA")["sAMOTA_attacks.svg"]):
        words = re.findall(r">([^<>\n]+)</text>", svg)
        names = [each for each in words if each == "nobody lies" or each.startswith("cav_1=")]
        assert names == ["nobody lies", "cav_1=ghost(ahead_m=15)", "cav_1=remove"] and "attacks" in words
        assert not [each for each in words if "()" in each]
    (axis,) = Page(render_bench_report(table, About())).data["axes"]
    assert axis["label"] == "attacks" and axis["named"] and axis["values"] == [0, 1, 2] and axis["mildest"] == 0
    assert axis["texts"] == ["nobody lies", "cav_1=ghost(ahead_m=15)", "cav_1=remove"]


def test_the_page_has_all_tables() -> None:
    table = ResultTable.of(crash_results(conditions=LATE))
    page = Page(crashes_section(table))
    assert page.texts("h3") == ["What messages change", "What messages cost", "Under latency"]
    assert {"avoided", "caused", "gain ends at", "phantom brakes"} <= set(page.texts("th"))
    lied = Page(crashes_section(ResultTable.of(crash_results(conditions=ATTACKED))))
    assert "What lies cost" in lied.texts("h3") and "cav_1=remove" in lied.texts("td", "about")


def test_drives_as_traffic_has_them_stand_beside_those_made_to_need_messages() -> None:
    both = [Condition("interaction(kind=cut_in)"), Condition("merge_barrier")]
    results = crash_results(
        lambda policy, condition, seed: seed < RATES[policy] * (condition.scenario == "merge_barrier"),
        conditions=both,
        epdms=lambda policy: 100.0 - RATES[policy],
    )
    text = to_safety_markdown(ResultTable.of(results))
    rows = [" ".join(line.split()) for line in text.splitlines()]
    assert any(row.startswith("| as traffic has them | 0 % (0 to 28) |") for row in rows)
    assert any(row.startswith("| late_fusion | made to need messages | 10 | 50 % | 20 % | 3 | 0 |") for row in rows)
    scores = [row for row in rows if row.startswith("| late_fusion | as traffic has them | ")]
    assert any(
        row.startswith("| late_fusion | as traffic has them | epdms | 10 | 95.0 | 98.0 | +3.0") for row in scores
    )
    assert not any(
        "as traffic has them" in row for row in to_safety_markdown(ResultTable.of(crash_results())).splitlines()
    )
