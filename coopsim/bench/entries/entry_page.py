"""The page of the leaderboard: a ranked table for each kind of input, and each entry with its card."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.bench.entries.entry_folder import HEADINGS, EntryFolder, digest_of
from coopsim.bench.entries.fixed_run import SCORED, SHOWN
from coopsim.bench.grid.cell import short_label
from coopsim.bench.report.bench_text import (
    BYTES_TITLE,
    difference_text,
    form_of,
    format_p_value,
    format_value,
    interval_beside,
    markdown_table,
)
from coopsim.bench.report.formats import definitions, fill_page
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import Standing, standings
from coopsim.bench.results.statistics import bootstrap_difference, holm, sign_flip_p_value
from coopsim.errors import InvalidValueError
from coopsim.metrics.built_in import BYTES
from coopsim.support.checks import require_choice
from coopsim.support.files import make_folder, write_whole

_TITLES = {"boxes": "Policies that read boxes", "sensors": "Policies that read sweeps or pictures"}

_RULES = """Mean over the conditions of the preset <code>leaderboard</code>, with half of its 95 % interval over towns.
A difference is paired by town, with its 95 % interval (bootstrap-t); p is the larger of the bootstrap's and the exact
sign-flip test's, corrected by Holm. Policies on boxes get simulated detections and the others sweeps or pictures, so
they are ranked apart. An entry whose check fails is not here."""


@dataclass(frozen=True, slots=True)
class Row:
    """An entry with its scores.

    Attributes:
        scores: content of `scores.json`.
        card: text below each heading.
        digest: digest of the code.
    """

    entry: EntryFolder
    scores: Mapping[str, Any]
    card: Mapping[str, str]
    digest: str

    @classmethod
    def of(cls, folder: Path) -> Row:
        """Read a folder that has passed `check_folder`."""
        entry = EntryFolder.read(folder)
        return cls(entry, SCORED.read(entry), entry.card(), digest_of(entry.code()))


class Board:
    """The ranked entries.

    Args:
        rows: entries whose check has passed, each with a name of its own.
        baseline: name of the entry that the others are compared with.

    Raises:
        InvalidValueError: there are no entries.
        UnknownNameError: there is no entry of the baseline's name.
    """

    def __init__(self, rows: Sequence[Row], baseline: str) -> None:
        if not rows:
            raise InvalidValueError("a leaderboard needs at least one entry whose check passes")
        require_choice("baseline", baseline, [row.entry.name for row in rows])
        self._rows, self._baseline = {row.entry.name: row for row in rows}, baseline
        self._heads = ("rank", "entry", *SHOWN, f"{SHOWN[0]} against {baseline}", "p", "worst", "worst in", BYTES_TITLE)
        kinds = {row.scores["reads"] for row in rows}
        self._tables = {title: self._table(reads) for reads, title in _TITLES.items() if reads in kinds}

    def text(self) -> str:
        """Return the tables as Markdown."""
        return "\n\n".join(
            f"{title}\n\n{markdown_table(self._heads, rows, texts=2)}" for title, rows in self._tables.items()
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
            tables="".join(f"<h2>{title}</h2>{self._table_html(rows)}" for title, rows in self._tables.items()),
            rules=_RULES,
            entries="".join(self._section(row) for row in self._rows.values()),
        )

    def _table(self, reads: str) -> list[tuple[str, ...]]:
        """Return the cells of the entries that read one kind of input, by rank."""
        rows = [row for row in self._rows.values() if row.scores["reads"] == reads]
        table = ResultTable.of([result for row in rows for result in SCORED.results(row.entry, row.scores)])
        changes = changes_from(table, self._baseline)
        return [self._cells(table, standing, changes) for standing in standings(table, SHOWN[0])]

    def _cells(self, table: ResultTable, standing: Standing, changes: Mapping[str, tuple[str, str]]) -> tuple[str, ...]:
        k = table.policies.index(standing.policy)
        means = [table.interval(name, table.values(name)[k].mean(axis=0)) for name in SHOWN]
        worst = standing.worst_condition
        return (
            "-" if standing.rank is None else str(standing.rank),
            standing.policy,
            *(f"{format_value(each.mean, '.1f')} {interval_beside(each, '.1f')}".strip() for each in means),
            *changes.get(standing.policy, ("-", "-")),
            format_value(standing.worst, ".1f"),
            "-" if worst is None else short_label(worst, table.conditions),
            format_value(standing.bytes_per_s, form_of(BYTES)),
        )

    def _table_html(self, rows: Sequence[Sequence[str]]) -> str:
        def line(cells: Sequence[str], tag: str) -> str:
            about = ["", ' class="about"', *[""] * (len(cells) - 2)]
            return "".join(f"<{tag}{css}>{cell}</{tag}>" for cell, css in zip(cells, about, strict=True))

        numbers = {name: k for k, name in enumerate(self._rows)}
        body = []
        for row in rows:
            rank, name, *others = map(html.escape, row)
            link = f'<a href="#entry-{numbers[row[1]]}">{name}</a>'
            body.append(f"<tr>{line([rank, link, *others], 'td')}</tr>")
        heads = line([html.escape(head) for head in self._heads], "th")
        return f'<div class="scroll"><table><thead><tr>{heads}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'

    def _section(self, row: Row) -> str:
        """Return an entry's part of the page."""
        entry, number = row.entry, list(self._rows).index(row.entry.name)
        facts = {
            "policy": entry.policy,
            "authors": ", ".join(entry.authors),
            "licence": entry.license,
            "check": f"coopsim entry check {entry.folder.name}",
            "digest of the code": row.digest,
            "versions": ", ".join(f"{name} {number}" for name, number in row.scores["software"].items()),
            "networks multiply in": row.scores["arithmetic"],
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


def enter_all(folders: Sequence[Path], problems: Mapping[Path, Sequence[str]]) -> tuple[list[Row], list[str]]:
    """Return the rows of the folders without problems, and a line for each problem of the others."""
    rows: dict[str, Row] = {}
    lines = [f"{folder}: {problem}" for folder in folders for problem in problems[folder]]
    for folder in folders:
        if problems[folder]:
            continue
        row = Row.of(folder)
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
