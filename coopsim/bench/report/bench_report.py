"""The report of a benchmark or demonstration: one HTML file that opens without a network."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from coopsim.bench.films.crash_pairs import CRASH
from coopsim.bench.grid.labels import label, values_of, varying_axes
from coopsim.bench.report.answer import Answer, answer_of
from coopsim.bench.report.bench_tables import condition_table, failures, leaderboard
from coopsim.bench.report.crashes_page import crashes_section, lies_section
from coopsim.bench.report.film_data import DRAWING
from coopsim.bench.report.film_section import FilmSection, space_of, split_lead
from coopsim.bench.report.formats import definitions, fill_page
from coopsim.bench.report.scene import Scene
from coopsim.bench.report.space_data import SPACE_SCRIPTS
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.text.bench_text import COUNTS_TITLE, METHODS_TITLE
from coopsim.bench.text.forms import interval_kinds
from coopsim.metrics.built_in import BYTES, all_metrics, less_is_better
from coopsim.support.files import write_whole
from coopsim.viz.charts import policy_styles


@dataclass(frozen=True, slots=True, eq=False)
class About:
    """Texts of a report besides the results.

    Attributes:
        title: its title; empty: the question that the benchmark asks.
        command: the command that gives the same results again.
        settings: configuration and versions by name.
        date: days on which runs ended; empty: unknown.
    """

    title: str = ""
    command: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)
    date: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """Films that a report plays, by section, and lines on those that are missing.

    The first one stands below the answer.
    """

    sections: Sequence[FilmSection] = ()
    notes: Sequence[str] = ()

    def data(self) -> list[dict[str, Any]]:
        """Return plain data of all figures for the page's script."""
        return [figure.data for section in self.sections for figure in section.figures]


def write_bench_report(
    path: Path,
    table: ResultTable,
    about: About,
    played: Played | None = None,
    scene: Scene | None = None,
) -> Path:
    """Write the report of `render_bench_report`; the file appears whole or not at all."""
    return write_whole(path, render_bench_report(table, about, played, scene))


def render_bench_report(
    table: ResultTable,
    about: About,
    played: Played | None = None,
    scene: Scene | None = None,
) -> str:
    """Return the report as HTML; equal results give equal text.

    Where cars were driven it has their crash rates. Sections of `played` films without a figure are left out; without a
    `scene` of runs to watch side by side, the sections "From above", "Reward over time" and "Cameras".
    """
    shown, played, answer = table.shown, played or Played(), answer_of(table)
    lead, others = split_lead(played.sections)
    space = scene.space if scene else space_of(played.sections)
    return fill_page(
        "bench.html",
        style=("page.css", "bench.css", *(["space.css"] if space else [])),
        script=("bev.js", "curves.js", "bench.js", *(["scene.js"] if scene else []), *(SPACE_SCRIPTS if space else [])),
        data={
            **_data(table, played),
            **({"scene": scene.data()} if scene else {}),
            **({"space": space.data()} if space else {}),
        },
        title=title_of_report(about.title, answer),
        summary=f"{_summary(table)}, {about.date}" if about.date else _summary(table),
        answer=answer.html() if answer else "",
        leaderboards="".join(
            f'<div data-metric="{html.escape(name)}"{" hidden" * (name != shown[0])}>{leaderboard(table, name)}</div>'
            for name in shown
        )
        or '<p class="note">No run was finished, so there is nothing to rank.</p>',
        interval=_interval_note(table),
        scene=scene.html() if scene else "",
        crashes=crashes_section(table) + lies_section(table),
        lead=lead,
        films=others,
        notes="".join(f'<p class="note">{html.escape(note)}</p>' for note in played.notes),
        tables="".join(
            f"<details{' open' * (k == 0)}><summary>{html.escape(label(condition, table.conditions))}</summary>"
            f"{condition_table(table, k)}</details>"
            for k, condition in enumerate(table.conditions)
        ),
        methods=_section(METHODS_TITLE, definitions(table.methods) if table.methods else ""),
        counted=_section(COUNTS_TITLE, definitions(table.counted) if table.counted else ""),
        failures=_section("Failed runs", failures(table)),
        meaning=definitions({name: each.definition for name, each in all_metrics().items() if name in (*shown, BYTES)}),
        settings=definitions(about.settings),
        command=f"<pre>{html.escape(about.command)}</pre>" if about.command else "",
    )


def _section(title: str, content: str) -> str:
    """Return a section; empty without content."""
    return f"<section><h2>{title}</h2>{content}</section>\n" if content else ""


def title_of_report(title: str, answer: Answer | None) -> str:
    """Return a report's title: the one that was asked for, else the question of the benchmark."""
    return title or (answer.question if answer else "coopsim bench")


def _summary(table: ResultTable) -> str:
    counts = (
        (len(table.policies), "policy", "policies"),
        (len(table.conditions), "condition", "conditions"),
        (len(table.seeds), "seed", "seeds"),
    )
    grid = " x ".join(f"{count} {one if count == 1 else many}" for count, one, many in counts)
    if table.samples.are_places:
        grid += f" in {'one place' if table.samples.places == 1 else f'{table.samples.places} places'}"
    faults = ((len(table.failures), "failed"), (table.missing, "not run"))
    state = "".join(f", {count} {word}" for count, word in faults if count)
    length = f"{table.frames} frames each" if table.frames else "whole episodes"
    return f"{grid}, {length}: {int(table.finished.sum())} runs finished{state}"


def _interval_note(table: ResultTable) -> str:
    samples = table.samples
    if samples.count == 1:
        alone = f"There is {samples.text}, and so no interval: what another would give is not known."
        return f"{alone} {table.caution}".rstrip()
    meaning = f"± and whiskers are 95 % intervals of the mean over {samples.text}, by {interval_kinds(table.shown)}"
    if samples.are_places and samples.count < len(table.seeds):
        meaning += "; a place counts once, with the mean of its seeds"
    if samples.in_one_place:
        meaning += "; what another place would give is not known"
    return f"{meaning}; whiskers end where the scale does. {table.caution}".rstrip()


def _data(table: ResultTable, played: Played) -> dict[str, Any]:
    axes = varying_axes(table.conditions)
    texts = [values_of(axis, table.conditions) for axis in axes]
    values = [list(each) for each in texts]
    scenarios = table.scenarios
    metrics = [*table.shown, *([BYTES] if BYTES in table.metrics else [])]
    at = [
        tuple(each.index(axis.value(condition)) for axis, each in zip(axes, values, strict=True))
        for condition in table.conditions
    ]
    return {
        "policies": list(table.names.values()),
        "looks": [[each.color, each.dash, each.marker] for each in policy_styles(table.policies).values()],
        "scenarios": scenarios,
        "metrics": [{"name": name, "less": less_is_better(name)} for name in table.shown],
        "axes": [
            {
                "title": axis.title,
                "label": axis.label,
                "values": list(range(len(each))) if axis.named else [_json(float(value)) for value in each],
                "texts": list(each.values()),
                "named": axis.named,
                "mildest": list(each).index(min(each, key=axis.harm)),
            }
            for axis, each in zip(axes, texts, strict=True)
        ],
        "conditions": [
            {"scenario": scenarios.index(condition.scenario), "at": list(place)}
            for condition, place in zip(table.conditions, at, strict=True)
        ],
        "values": {name: _intervals(table, name, [[k] for k in range(len(at))]) for name in metrics},
        "pooled": _pooled(table, metrics, at) if len(scenarios) > 1 else None,
        "bytes": BYTES,
        "bounds": [k for k, name in enumerate(table.policies) if name in table.bounds],
        "drawing": dict(DRAWING),
        "pairs": played.data(),
    }


def _pooled(table: ResultTable, metrics: Iterable[str], at: Sequence[tuple[int, ...]]) -> dict[str, Any]:
    """Return means over scenarios, by what is the same of their conditions."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for k, place in enumerate(at):
        groups.setdefault(place, []).append(k)
    noun = "situations" if CRASH in table.metrics else "environments"
    values = {name: _intervals(table, name, list(groups.values())) for name in metrics}
    return {"name": f"{len(table.scenarios)} {noun}", "at": [list(place) for place in groups], "values": values}


def _intervals(table: ResultTable, metric: str, groups: Sequence[Sequence[int]]) -> list[list[list[float | None]]]:
    """Return mean, low and high, by policy and group of conditions."""
    means = [[table.mean(metric, policy, group) for group in groups] for policy in range(len(table.policies))]
    return [[[_json(value) for value in (each.mean, each.low, each.high)] for each in row] for row in means]


def _json(value: float) -> float | None:
    """Round to five digits; None for numbers that JSON does not have."""
    return float(f"{value:.5g}") if math.isfinite(value) else None
