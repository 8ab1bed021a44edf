"""The benchmark's report: one file that fetches nothing, shows every result, and takes names for text."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from html_page import HOSTILE, Page
from synthetic_results import FRAMES, LATENCIES, failed, result, results

from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.report.bench_plots import plots
from coopsim.bench.report.bench_report import About, Played, render_bench_report, write_bench_report
from coopsim.bench.report.publish import publish
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import mean_interval
from coopsim.bench.text.bench_text import leaderboard_text, to_csv, to_markdown
from coopsim.errors import UnknownNameError
from tests.helpers.crashes import crash_results

TABLE = ResultTable.of(results())
ABOUT = About("a title", "coopsim bench --seeds 0,1,2", {"frames": "40"})


def page(table: ResultTable = TABLE, about: About = ABOUT) -> Page:
    return Page(render_bench_report(table, about))


def test_one_file_that_fetches_nothing() -> None:
    text = render_bench_report(TABLE, ABOUT)
    for tag, attributes, _ in Page(text).elements:
        assert tag not in {"link", "iframe", "object", "embed", "base"}
        assert not {"src", "href", "srcset", "action"}.intersection(attributes)
    addresses = set(re.findall(r"https?:[^\"'\s]*", text))
    assert addresses == {"http://www.w3.org/2000/svg"}, "a name, and nothing to fetch"
    assert not re.search(r"url\(|@import|\bfetch\b|XMLHttpRequest|WebSocket|\bimport\b", text)


def test_what_the_script_draws_are_the_intervals() -> None:
    data = page().data
    assert data["policies"] == list(TABLE.policies) and data["scenarios"] == ["crossing"]
    assert [metric["name"] for metric in data["metrics"]] == ["sAMOTA", "HOTA", "IDS"]
    assert [metric["less"] for metric in data["metrics"]] == [False, False, True]
    (axis,) = data["axes"]
    assert axis["title"] == "latency" and axis["values"] == [0, 100, 500] and axis["mildest"] == 0
    assert axis["texts"] == ["0 ms", "100 ms", "500 ms"]
    for metric in ("sAMOTA", "HOTA", "IDS", "bytes_per_s"):
        values = TABLE.values(metric)
        for policy, condition in itertools.product(range(3), range(3)):
            interval = mean_interval(values[policy, condition])
            shown = data["values"][metric][policy][condition]
            assert shown == pytest.approx([interval.mean, interval.low, interval.high], rel=1e-4)


def test_only_axes_that_vary_are_there_and_no_limit_is_the_mildest_bandwidth() -> None:
    conditions = [Condition(name, bandwidth_bit_s=rate) for name in ("b", "a") for rate in (1e6, math.inf)]
    data = page(ResultTable.of(results(conditions=conditions))).data
    assert data["scenarios"] == ["a", "b"]
    (axis,) = data["axes"]
    assert axis["values"] == [1, None] and axis["mildest"] == 1 and axis["texts"] == ["1 Mbit/s", "no limit"]
    assert [(each["scenario"], each["at"]) for each in data["conditions"]] == [(0, [0]), (0, [1]), (1, [0]), (1, [1])]
    assert page(ResultTable.of(results(conditions=LATENCIES[:1]))).data["axes"] == []


def test_the_leaderboard_is_in_order_and_each_metric_has_one() -> None:
    shown = page()
    boards = [attributes for tag, attributes, _ in shown.elements if tag == "div" and "data-metric" in attributes]
    assert [(each["data-metric"], "hidden" in each) for each in boards] == [
        ("sAMOTA", False), ("HOTA", True), ("IDS", True)
    ]  # fmt: skip
    names = [text for text in shown.texts("td", "about") if text in TABLE.policies]
    assert names[:3] == ["good", "middling", "bad"]
    assert "500 ms" in shown.texts("td", "about where")


def test_all_says_what_there_is() -> None:
    shown = page()
    assert shown.texts("title") == shown.texts("h1") == ["a title"]
    assert "3 policies x 3 conditions x 3 seeds, 40 frames each: 27 runs finished" in shown.texts("p")
    assert "40" in shown.texts("dd") and "coopsim bench --seeds 0,1,2" in shown.texts("pre")
    assert any("95 % intervals of the mean over 3 seeds, by Student's t" in text for text in shown.texts("p", "note"))
    assert "Worst moments" not in shown.texts("h2"), "no clips, no section"
    notes = Page(render_bench_report(TABLE, ABOUT, Played(notes=["1 clip <is> missing"]))).texts("p", "note")
    assert "1 clip <is> missing" in notes


def test_one_seed_has_no_interval_and_says_so() -> None:
    shown = page(ResultTable.of(results(seeds=(4,))))
    assert all(low is None for low in (shown.data["values"]["sAMOTA"][0][0][1:]))
    assert any("There is one seed, and so no interval" in text for text in shown.texts("p", "note"))
    assert not any("±" in text for text in shown.texts("td"))


@pytest.mark.parametrize(
    ("seeds", "places", "said"),
    [
        (range(3), [0, 1, 2], "95 % intervals of the mean over 3 places, by Student's t; whiskers"),
        (range(4), [7, 8, 7, 8], "the mean over 2 places, by Student's t; a place counts once, with the mean of its"),
        (range(3), [5, 5, 5], "over 3 seeds in one place, by Student's t; what another place would give is not known"),
        (range(1), [5], "There is one place, and so no interval: what another would give is not known."),
    ],
)
def test_places_are_samples_and_the_report_says_so(seeds: range, places: list[int], said: str) -> None:
    drawn = [replace(each, place_seed=places[each.cell.seed]) for each in results(seeds=seeds)]
    table = ResultTable.of(drawn)
    assert any(said in text for text in page(table).texts("p", "note"))
    assert f"{table.samples.text} (Student's t)." in to_markdown(table, "towns") or len(seeds) == 1
    assert to_csv(table).splitlines()[0].split(",").count("place_seed") == 1
    assert "place_seed" not in to_csv(TABLE)


@pytest.mark.parametrize("text", HOSTILE)
def test_names_and_tracebacks_stay_text(text: str) -> None:
    def shown(name: str) -> Page:
        cells = [Cell(name, Condition(f"{name}{k}"), 0, FRAMES) for k in range(3)]
        given = [result(cells[0], 50.0), result(cells[1], 40.0), failed(cells[2], f"Traceback:\n{name}\n")]
        return page(ResultTable.of(given), About(name, name, {name: name}))

    plain, hostile = shown("plain"), shown(text)
    assert [(tag, attrs.keys()) for tag, attrs, _ in hostile.elements] == [
        (tag, attrs.keys()) for tag, attrs, _ in plain.elements
    ]
    assert hostile.texts("title") == [text] and text in hostile.texts("td", "about")
    assert hostile.texts("pre") == [f"Traceback:\n{text}\n", text] and hostile.data["policies"] == [text]
    markdown = to_markdown(ResultTable.of([result(Cell(text, Condition(), 0, FRAMES), 50.0)]), text)
    assert "<script" not in markdown.replace("\\<", "") and len(markdown.splitlines()) == 13


def test_nothing_in_the_data_looks_like_a_tag() -> None:
    given = [result(Cell(name, Condition(), 0, FRAMES), 50.0) for name in HOSTILE]
    data = render_bench_report(ResultTable.of(given), ABOUT).split('id="data">')[1].split("</script>")[0]
    assert len(data) > 500 and "<" not in data


def test_failed_missing_and_undefined_cells_are_shown() -> None:
    given = results()
    given[3] = failed(given[3].cell, "Traceback (most recent call last):\nValueError: <no>\n")
    given[4] = replace(given[4], values={**given[4].values, "sAMOTA": math.nan, "HOTA": math.inf})
    table = ResultTable.of(given[:-1])
    shown = page(table)
    assert any("25 runs finished, 1 failed, 1 not run" in text for text in shown.texts("p"))
    assert "good, latency 100 ms, seed 0: " in shown.texts("summary") and "ValueError: <no>" in shown.texts("code")
    assert shown.texts("td", "failed")[:2] == ["8 of 9, 1 not run", "8 of 9, 1 failed"]
    markdown = to_markdown(table, "t")
    assert "- good, latency 100 ms, seed 0: ValueError: \\<no\\>" in markdown


def test_every_cell_failed() -> None:
    table = ResultTable.of([failed(each.cell) for each in results()])
    shown = page(table)
    assert shown.data["metrics"] == [] and len(shown.texts("pre")) == 28
    assert "Failed runs" in to_markdown(table, "t") and to_csv(table).count("\n") == 28
    assert plots(ResultTable.of(results(conditions=LATENCIES[:1])), "sAMOTA") == {}


def test_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    paths = [write_bench_report(tmp_path / f"{k}.html", ResultTable.of(given), ABOUT) for k, given in
             enumerate((results(), results()[::-1]))]  # fmt: skip
    assert paths[0].read_bytes() == paths[1].read_bytes()
    other = ResultTable.of(results()[::-1])
    assert to_csv(other) == to_csv(TABLE) and to_markdown(other, "t") == to_markdown(TABLE, "t")
    assert plots(other, "sAMOTA") == plots(TABLE, "sAMOTA")


def test_csv_has_every_cell_unrounded() -> None:
    given = results()
    given[0] = failed(given[0].cell)
    rows = list(csv.DictReader(io.StringIO(to_csv(ResultTable.of(given)))))
    assert len(rows) == 27
    for row, each in zip(rows, sorted(given, key=lambda one: one.cell), strict=True):
        assert row["policy"] == each.cell.policy and int(row["seed"]) == each.cell.seed
        assert float(row["latency_s"]) == each.cell.condition.latency_s and float(row["bandwidth_bit_s"]) == math.inf
        if each.failed:
            assert row["failed"] == "True" and row["sAMOTA"] == row["messages_sent"] == ""
        else:
            assert float(row["sAMOTA"]) == each.values["sAMOTA"] and row["messages_sent"] == "10"


def test_what_stands_behind_a_row_is_shown() -> None:
    saying = [replace(each, method="half of <a paper>") for each in results() if each.cell.policy == "bad"]
    table = ResultTable.of(saying)
    assert table.methods == {"bad": "half of <a paper>"} and TABLE.methods == {}
    heading = "Methods of the policies"
    assert f"## {heading}\n\n- bad: half of \\<a paper\\>" in to_markdown(table, "t")
    assert "half of &lt;a paper&gt;" in render_bench_report(table, ABOUT)
    assert heading not in to_markdown(TABLE, "t") + render_bench_report(TABLE, ABOUT)


def test_what_policies_count_is_shown_for_all_their_cells() -> None:
    counting = [replace(each, counts={"odd <pairs>": 2}) if each.cell.policy == "bad" else each for each in results()]
    table = ResultTable.of(counting)
    assert table.counted == {"bad": "18 odd <pairs>"} and TABLE.counted == {}
    assert "- bad: 18 odd \\<pairs\\>" in to_markdown(table, "t") and "Counted" not in to_markdown(TABLE, "t")
    assert "18 odd &lt;pairs&gt;" in render_bench_report(table, ABOUT)
    assert "Counted" not in render_bench_report(TABLE, ABOUT)
    rows = list(csv.DictReader(io.StringIO(to_csv(table))))
    assert {(row["policy"], row["counts_odd <pairs>"]) for row in rows} == {
        ("bad", "2"),
        ("good", ""),
        ("middling", ""),
    }


def test_markdown_has_the_leaderboard_and_each_condition() -> None:
    text = to_markdown(TABLE, "results")
    heads = [line for line in text.splitlines() if line.startswith("#")]
    assert heads == ["# results", "## latency 0 ms", "## latency 100 ms", "## latency 500 ms"]
    board = [line.split("|")[2].strip() for line in text.split("\n\n")[1].splitlines()[2:]]
    assert board == ["good", "middling", "bad"]
    interval = mean_interval(TABLE.values("HOTA")[1, 2])
    assert f"{interval.mean:.1f} ± {interval.half_width:.1f}" in text.split("## latency 500 ms")[1]
    with pytest.raises(UnknownNameError, match="unknown metric"):
        to_markdown(TABLE, "t", ["nothing"])


def test_plots_have_a_line_for_each_policy_and_a_panel_for_each_scenario() -> None:
    conditions = [
        Condition(name, latency_s=latency_s, bandwidth_bit_s=rate)
        for name in ("a <b>", "$c$")
        for latency_s in (0.0, 0.2)
        for rate in (1e6, math.inf)
    ]
    table = ResultTable.of(results({"_x": 50.0, "y": 40.0}, conditions))
    drawn = plots(table, "sAMOTA")
    assert set(drawn) == {"sAMOTA_latency.svg", "sAMOTA_bandwidth.svg"}
    for text in drawn.values():
        assert text.startswith("<?xml") and "a &lt;b&gt;" in text and "$c$" in text and "_x" in text
    assert "no limit" in drawn["sAMOTA_bandwidth.svg"] and "no limit" not in drawn["sAMOTA_latency.svg"]


def test_large_grids_stay_small_files() -> None:
    conditions = [Condition(latency_s=k / 20, loss=j / 10) for k in range(6) for j in range(3)]
    table = ResultTable.of(results({f"policy_{k}": 10.0 * k for k in range(8)}, conditions))
    assert len(render_bench_report(table, ABOUT)) < 400_000


def test_json_has_no_number_that_browsers_refuse() -> None:
    def refuse(name: str) -> Any:
        raise AssertionError(name)

    given = results()
    given[0] = replace(given[0], values=dict.fromkeys(given[0].values, np.nan))
    text = render_bench_report(ResultTable.of(given), ABOUT).split('id="data">')[1].split("</script>")[0]
    json.loads(text, parse_constant=refuse)


def test_the_tables_say_in_which_numbers_networks_multiply() -> None:
    given = [replace(each, arithmetic="bfloat16") for each in results()]
    assert "\n\nNetworks multiply in bfloat16.\n\n" in to_markdown(ResultTable.of(given), "t")
    assert "Networks" not in to_markdown(TABLE, "t")


def _ranked_by(folder: Path, **options: Any) -> tuple[list[str], str, str]:
    """Publish runs with crashes; return the metrics of the page, that of its leaderboard, and that of Markdown."""
    folder.mkdir()
    publish(folder, crash_results(sAMOTA=lambda policy: 50.0 + len(policy)), clips=0, **options)
    shown = Page((folder / "report.html").read_text(encoding="utf-8"))
    boards = [attributes for tag, attributes, _ in shown.elements if tag == "div" and "data-metric" in attributes]
    (first,) = [each["data-metric"] for each in boards if "hidden" not in each]
    lines = (folder / "report.md").read_text(encoding="utf-8").splitlines()
    heads = next(line for line in lines if line.startswith("|")).split("|")
    return [each["name"] for each in shown.data["metrics"]], first, heads[3].strip()


def test_the_metrics_that_are_asked_for_begin_every_report(tmp_path: Path) -> None:
    asked = ("phantom_brakes", "impact_speed")
    metrics, first, markdown = _ranked_by(tmp_path / "asked", metrics=asked)
    assert metrics[:2] == list(asked) and {"crash", "sAMOTA"} < set(metrics) and len(metrics) == len(set(metrics))
    assert first == markdown == asked[0]


def test_where_cars_were_driven_crashes_rank(tmp_path: Path) -> None:
    metrics, first, markdown = _ranked_by(tmp_path / "usual")
    assert metrics[0] == first == markdown == "crash"
    assert leaderboard_text(ResultTable.of(crash_results())).splitlines()[0].split("|")[3].strip() == "crash"
