"""The page of the leaderboard: tables of the ranking runs, a table of what entries report, and each entry's card."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.bench.entries.entry_folder import HEADINGS, EntryFolder
from coopsim.bench.entries.fixed_run import SCORED, SHOWN
from coopsim.bench.grid.labels import short_label
from coopsim.bench.report.formats import definitions, fill_page
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import Standing, standings
from coopsim.bench.results.statistics import bootstrap_difference, holm, sign_flip_p_value
from coopsim.bench.text.bench_text import WORST_CONDITION
from coopsim.bench.text.forms import (
    BYTES_TITLE,
    difference_text,
    form_of,
    format_p_value,
    format_value,
    interval_beside,
    markdown_table,
)
from coopsim.errors import InvalidValueError
from coopsim.metrics.built_in import BYTES
from coopsim.support.checks import require_choice
from coopsim.support.files import make_folder, write_whole

_TITLES = {"boxes": "Policies that read boxes", "sensors": "Policies that read sweeps or pictures"}

_REPORTED = "Self-reported, without ranks"

_RULES = """<b>Ranks</b> come from runs of the organisers alone. Their towns are decided by a secret salt, of which this
page has a digest, so nobody else can make them again. Mean over the conditions of the preset <code>leaderboard</code>,
with half of its 95 % interval over towns. A difference is paired by town, with its 95 % interval (bootstrap-t); p is
the larger of the bootstrap's and the exact sign-flip test's, corrected by Holm. Policies on boxes get simulated
detections and the others sweeps or pictures, so they are ranked apart.</p>
<p class="note"><b>Self-reported</b> scores are those of the entrants, in public towns that a policy could know by
heart. A check repeats some cells of them, and no more: they have no rank, and stand by name.</p>
<p class="note"><b>Isolated</b> is each agent of a policy: a process of its own, which gets that agent's observations,
and seeds that do not name the town's. There is no salt in arguments, environment or memory that it can read. It has no
privileges, and limits of memory, processor time, files and threads. Each entry below says whether it also had a user of
its own, only named files to read, nothing to write to, and no network. <b>Not isolated</b> are the agents of one policy
from signals beside the data, such as the load of the processor and locks of files. All share one kernel: this is no
virtual machine."""


@dataclass(frozen=True, slots=True)
class Row:
    """An entry with its scores.

    Attributes:
        scores: content of `scores.json`, which the entry reports of itself.
        card: text below each heading.
        digest: digest of all that is the entry's own.
        ranking: scores of the organisers' run of it as it is; None: they have not run it.
    """

    entry: EntryFolder
    scores: Mapping[str, Any]
    card: Mapping[str, str]
    digest: str
    ranking: Mapping[str, Any] | None = None

    @classmethod
    def of(cls, folder: Path, rankings: Mapping[str, Mapping[str, Any]]) -> Row:
        """Read a folder that has passed `check_folder`; `rankings` as of `read_rankings`."""
        entry = EntryFolder.read(folder)
        digest = entry.digest
        return cls(entry, SCORED.read(entry), entry.card(), digest, rankings.get(digest))


class Board:
    """The entries: ranked by the organisers' runs, and by name with what they report.

    Args:
        rows: entries whose check has passed, each with a name of its own.
        baseline: name of the entry that the ranked others are compared with.

    Raises:
        InvalidValueError: there are no entries.
        UnknownNameError: entries are ranked, and none has the baseline's name.
    """

    def __init__(self, rows: Sequence[Row], baseline: str) -> None:
        if not rows:
            raise InvalidValueError("a leaderboard needs at least one entry whose check passes")
        self._rows, self._baseline = {row.entry.name: row for row in rows}, baseline
        ranked = {row.entry.name: row.ranking for row in rows if row.ranking is not None}
        if ranked:
            require_choice("baseline", baseline, ranked)
        more = f"{SHOWN[0]} against {baseline}", "p", "worst", WORST_CONDITION
        heads = "rank", "entry", *SHOWN, *more, BYTES_TITLE
        kinds = {ranking["reads"] for ranking in ranked.values()}
        self._tables: dict[str, tuple[tuple[str, ...], list[tuple[str, ...]]]] = {
            title: (heads, self._ranked({name: each for name, each in ranked.items() if each["reads"] == reads}))
            for reads, title in _TITLES.items()
            if reads in kinds
        }
        self._tables[_REPORTED] = ("entry", "reads", *SHOWN, BYTES_TITLE), self._reported()

    def text(self) -> str:
        """Return the tables as Markdown."""
        return "\n\n".join(
            f"{title}\n\n{markdown_table(heads, rows, texts=2)}" for title, (heads, rows) in self._tables.items()
        )

    def html(self) -> str:
        """Return the page."""
        count = len(self._rows)
        towns = len({cell.seed for cell in SCORED.cells("").values()})
        return fill_page(
            "leaderboard.html",
            title="coopsim leaderboard",
            summary=f"{count} entr{'y' if count == 1 else 'ies'}, {towns} towns. Rows without code do not enter.",
            style=("page.css", "bench.css"),
            script=(),
            data={},
            tables="".join(f"<h2>{title}</h2>{self._table_html(*each)}" for title, each in self._tables.items()),
            rules=_RULES,
            entries="".join(self._section(row) for row in self._rows.values()),
        )

    def _ranked(self, rankings: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
        """Return the cells of ranked entries, by rank."""
        table = self._results(rankings)
        changes = changes_from(table, self._baseline)
        return [self._cells(table, standing, changes) for standing in standings(table, SHOWN[0])]

    def _reported(self) -> list[tuple[str, ...]]:
        """Return the cells of all entries with what they report of themselves, by name."""
        table = self._results({name: row.scores for name, row in self._rows.items()})
        found = {each.policy: each for each in standings(table, SHOWN[0])}
        return [
            (name, self._rows[name].scores["reads"], *_means(table, name), _bytes(found[name]))
            for name in sorted(found)
        ]

    def _results(self, scores: Mapping[str, Mapping[str, Any]]) -> ResultTable:
        rows = self._rows
        return ResultTable.of(
            [each for name, told in scores.items() for each in SCORED.results(rows[name].entry, told)]
        )

    def _cells(self, table: ResultTable, standing: Standing, changes: Mapping[str, tuple[str, str]]) -> tuple[str, ...]:
        worst = standing.worst_condition
        return (
            "-" if standing.rank is None else str(standing.rank),
            standing.policy,
            *_means(table, standing.policy),
            *changes.get(standing.policy, ("-", "-")),
            format_value(standing.worst, ".1f"),
            "-" if worst is None else short_label(worst, table.conditions),
            _bytes(standing),
        )

    def _table_html(self, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
        place, numbers = heads.index("entry"), {name: k for k, name in enumerate(self._rows)}

        def line(cells: Sequence[str], tag: str) -> str:
            about = [' class="about"' if k == place else "" for k in range(len(cells))]
            return "".join(f"<{tag}{css}>{cell}</{tag}>" for cell, css in zip(cells, about, strict=True))

        body = []
        for row in rows:
            cells = [*map(html.escape, row)]
            cells[place] = f'<a href="#entry-{numbers[row[place]]}">{cells[place]}</a>'
            body.append(f"<tr>{line(cells, 'td')}</tr>")
        head = line([html.escape(each) for each in heads], "th")
        return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'

    def _section(self, row: Row) -> str:
        """Return an entry's part of the page."""
        entry, number = row.entry, list(self._rows).index(row.entry.name)
        facts = {
            "policy": entry.policy,
            "authors": ", ".join(entry.authors),
            "licence": entry.license,
            "check": f"coopsim entry check {entry.folder.name}",
            "digest of the entry": row.digest,
            **_run_facts("ranking run", row.ranking),
            **_run_facts("self-reported", row.scores),
        }
        link = f'<p><a href="{html.escape(entry.url)}">{html.escape(entry.url)}</a></p>' if entry.url else ""
        card = "".join(f"<h4>{heading}</h4>{_paragraphs(row.card[heading])}" for heading in HEADINGS)
        return f'<h3 id="entry-{number}">{html.escape(entry.name)}</h3>{link}{definitions(facts)}{card}'


def changes_from(table: ResultTable, baseline: str) -> dict[str, tuple[str, str]]:
    """Compare entries with the baseline by the first metric. Return difference with interval, and p, by entry.

    Without the baseline in the table there are none.
    """
    others = [name for name in table.policies if name != baseline]
    if baseline not in table.policies or not others:
        return {}
    by_place = dict(
        zip(table.policies, table.samples.average(table.values(SHOWN[0]).mean(axis=1)), strict=True)
    )  # NaN where a cell has no value
    changes = {name: by_place[name] - by_place[baseline] for name in others}
    known = {name: change for name, change in changes.items() if not np.isnan(change).any()}
    found = {name: bootstrap_difference(change) for name, change in known.items()}
    p_values = holm(np.array([max(found[name][1], sign_flip_p_value(known[name])) for name in found]))
    return {
        name: (difference_text(found[name][0], ".1f"), format_p_value(p_value))
        for name, p_value in zip(found, p_values.tolist(), strict=True)
    }


def _run_facts(title: str, scores: Mapping[str, Any] | None) -> dict[str, str]:
    """Return what a page says of how scores were made."""
    if scores is None:
        return {title: "none of this entry as it is: it has no rank"}
    versions = ", ".join(f"{name} {number}" for name, number in scores["software"].items())
    facts = {title: f"{versions}; {scores['processor']}; networks multiply in {scores['arithmetic']}"}
    if "confinement" in scores:
        held = [f"{'' if holds else 'not: '}{name}" for name, holds in scores["confinement"].items()]
        facts |= {"processes of the policy": "; ".join(["one an agent", *held]), "digest of the salt": scores["salt"]}
    return facts


def _means(table: ResultTable, name: str) -> list[str]:
    """Return the means of the table's metrics over conditions, with intervals over towns, of an entry."""
    k = table.policies.index(name)
    means = [table.interval(metric, table.values(metric)[k].mean(axis=0)) for metric in SHOWN]
    return [f"{format_value(each.mean, '.1f')} {interval_beside(each, '.1f')}".strip() for each in means]


def _bytes(standing: Standing) -> str:
    return format_value(standing.bytes_per_s, form_of(BYTES))


def enter_all(
    folders: Sequence[Path], problems: Mapping[Path, Sequence[str]], rankings: Mapping[str, Mapping[str, Any]]
) -> tuple[list[Row], list[str]]:
    """Return the rows of the folders without problems, and a line for each problem of the others."""
    rows: dict[str, Row] = {}
    lines = [f"{folder}: {problem}" for folder in folders for problem in problems[folder]]
    for folder in folders:
        if problems[folder]:
            continue
        row = Row.of(folder, rankings)
        if row.entry.name in rows:
            lines.append(f"{folder}: name {row.entry.name!r} is that of {rows[row.entry.name].entry.folder}, too")
        else:
            rows[row.entry.name] = row
    return list(rows.values()), lines


def write_board(board: Board, out: Path) -> Path:
    """Write `index.html` into a folder, which is made if need be."""
    make_folder(out)
    return write_whole(out / "index.html", board.html())


def _paragraphs(text: str) -> str:
    return "".join(f"<p>{html.escape(' '.join(part.split()))}</p>" for part in text.split("\n\n") if part.strip())
