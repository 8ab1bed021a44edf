"""The order of a report: the answer, one film, what ranks, the rest; its date and machine; and words for strangers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from html_page import Page
from synthetic_results import failed, results

from coopsim.bench.grid.cell import Condition
from coopsim.bench.report.bench_report import About, Played, render_bench_report
from coopsim.bench.report.film_section import Figure, FilmSection, Panel
from coopsim.bench.report.publish import publish
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.safety_text import to_safety_markdown
from coopsim.bench.text.bench_text import to_markdown
from coopsim.bench.text.lies_text import to_lies_markdown
from tests.helpers.crashes import crash_results

PLACES = [Condition(name, latency_s=each) for name in ("crossing", "merge") for each in (0.0, 0.3)]
CRASHES = ResultTable.of(crash_results(conditions=PLACES))


def figure(name: str) -> Figure:
    """Return a figure of two runs without frames, of which the first tells a moment."""
    panels = [Panel(name, "crash at 30 km/h", [(1.0, "1.0 s crash")]), Panel("sharing", "no crash")]
    return Figure(f"caption of {name}", panels, {"of": name})


def test_a_report_opens_with_the_answer_and_one_film() -> None:
    sections = [FilmSection("Empty", "", (), []), FilmSection("Pairs", "note", (), [figure("a"), figure("b")])]
    text = render_bench_report(CRASHES, About(), Played(sections))
    parts = ['id="answer"', 'id="lead"', "caption of a", "<h2>Ranking", "<h2>Charts", "<h2>Crashes", "caption of b"]
    places = [text.index(each) for each in parts]
    assert places == sorted(places) and text.count("caption of a") == text.count("caption of b") == 1
    page = Page(text)
    shown = [attributes["data-pair"] for _, attributes, _ in page.elements if "data-pair" in attributes]
    assert [page.data["pairs"][int(k)]["of"] for k in shown] == ["a", "b"] and "Empty" not in page.texts("h2")


def test_pictures_have_words() -> None:
    text = render_bench_report(CRASHES, About(), Played([FilmSection("Pairs", "", (), [figure("alone")])]))
    pictures = [each for tag, each, _ in Page(text).elements if tag == "canvas"]
    assert pictures[0]["aria-label"] == "alone, from above. crash at 30 km/h. 1.0 s crash"
    assert all(each["role"] == "img" and each["aria-label"] for each in pictures)


def test_means_over_scenarios_stand_before_them() -> None:
    data = Page(render_bench_report(CRASHES, About())).data
    pooled = data["pooled"]
    assert (
        pooled["name"] == "2 situations" and pooled["at"] == [[0], [1]] and data["scenarios"] == ["crossing", "merge"]
    )
    policy = CRASHES.policies.index("no_fusion")
    mean = CRASHES.mean("crash", policy, [0, 2])
    assert pooled["values"]["crash"][policy][0] == pytest.approx([mean.mean, mean.low, mean.high], rel=1e-4)
    assert Page(render_bench_report(ResultTable.of(results()), About())).data["pooled"] is None


NOTED = [
    {"ended": "2026-11-28T01:00:00+00:00", "processor": "AMD, 2 cores", "platform": "Linux"},
    {"ended": "2026-11-27T23:00:00+00:00", "processor": "AMD, 2 cores", "platform": "Linux"},
    {"platform": "Old Linux"},
    {},
]


@pytest.mark.parametrize("noted", [NOTED, NOTED[::-1]])
def test_a_report_tells_when_and_where_its_runs_ended(noted: list[dict[str, Any]], tmp_path: Path) -> None:
    publish(tmp_path, results(), circumstances=noted)
    page = Page((tmp_path / "report.html").read_text())
    assert "2026-11-27 to 2026-11-28" in page.texts("dd") and "AMD, 2 cores, Linux; Old Linux" in page.texts("dd")
    assert any(text.endswith("runs finished, 2026-11-27 to 2026-11-28") for text in page.texts("p"))


def test_without_notes_there_is_no_date(tmp_path: Path) -> None:
    publish(tmp_path, results())
    assert not {"date", "machine"}.intersection(Page((tmp_path / "report.html").read_text()).texts("dt"))


def test_nothing_of_lies_stands_in_another_file_alone() -> None:
    attacked = [Condition("merge", attacks=each) for each in ("", "cav_1=remove")]
    table = ResultTable.of(crash_results(conditions=attacked, sAMOTA=lambda policy: 50.0 + len(policy)))
    page = Page(render_bench_report(table, About()))
    heads = [line.removeprefix("## ") for line in to_lies_markdown(table).splitlines() if line.startswith("## ")]
    assert heads and set(heads) <= set(page.texts("h3")) and "What lies change" in page.texts("h2")
    assert "What lies change" not in Page(render_bench_report(CRASHES, About())).texts("h2")


HOUSE_WORDS = re.compile(r"\b(undisturbed|least disturbed|worst in|cells?|mildest|telling|gone at|sharing)\b")


def test_no_house_words_are_shown() -> None:
    broken = [failed(each.cell) if k == 0 else each for k, each in enumerate(crash_results(conditions=PLACES))]
    table = ResultTable.of(broken)
    page = re.sub(r"<(script|style)\b.*?</\1>", "", render_bench_report(table, About()), flags=re.DOTALL)
    for text in (page, to_markdown(table, "t"), to_safety_markdown(table)):
        assert not HOUSE_WORDS.findall(re.sub(r"<[^>]*>", " ", text))


def test_values_are_made_once_and_to_read() -> None:
    table = ResultTable.of(results())
    values = table.values("sAMOTA")
    assert table.values("sAMOTA") is values and not values.flags.writeable
