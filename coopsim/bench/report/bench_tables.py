"""The tables of a benchmark's report, as HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from coopsim.bench.grid.labels import name_of_cell, short_label
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import Standing, standings
from coopsim.bench.results.statistics import Interval
from coopsim.bench.text.bench_text import CLEAN, WORST_CONDITION
from coopsim.bench.text.forms import BYTES_TITLE, form_of, format_value, interval_beside, title_of
from coopsim.metrics.built_in import BYTES, all_metrics, less_is_better

_STRIP_PX = (110, 14)


def leaderboard(table: ResultTable, metric: str) -> str:
    """Return the standings in one metric, sortable.

    The strip of each row shows the mean with its interval filled, and the worst condition hollow.
    """
    entries = standings(table, metric)
    several, calm = len(table.conditions) > 1, any(not math.isnan(entry.undisturbed) for entry in entries)
    low, high = _span(entries)
    form = form_of(metric)
    heads = [("rank", ""), ("policy", "about"), (metric, ""), ("95 %", "about")]
    if several:
        heads += [(CLEAN, "")] * calm + [("worst", "")]
    heads += [(BYTES_TITLE, "")] * (BYTES in table.metrics) + [("runs", "")]
    heads += [(WORST_CONDITION, "about")] * several
    rows = []
    for entry in entries:
        cells = [
            _cell("-" if entry.rank is None else str(entry.rank), entry.rank or math.inf),
            _cell(html.escape(table.names[entry.policy]), None, "about"),
            _cell(interval_html(entry.mean, form), entry.mean.mean),
            _cell(_strip(entry, low, high, several), None, "about"),
        ]
        if several:
            cells += [_cell(format_value(entry.undisturbed, form), entry.undisturbed)] * calm
            cells.append(_cell(format_value(entry.worst, form), entry.worst))
        if BYTES in table.metrics:
            cells.append(_cell(format_value(entry.bytes_per_s, _form(BYTES)), entry.bytes_per_s))
        cells.append(_state(entry, len(table.conditions) * len(table.seeds)))
        if several:
            where = "" if entry.worst_condition is None else short_label(entry.worst_condition, table.conditions)
            cells.append(_cell(html.escape(where), None, "about where"))
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return _table(heads, rows, sortable=True)


def condition_table(table: ResultTable, condition: int) -> str:
    """Return all shown metrics of every policy in one condition; the best of each is marked."""
    metrics = [*table.shown, *([BYTES] if BYTES in table.metrics else [])]
    columns = []
    for name in metrics:
        form = _form(name)
        intervals = [table.interval(name, values) for values in table.values(name)[:, condition]]
        means = [format_value(each.mean, form) for each in intervals]
        competing = [mean for mean, policy in zip(means, table.policies, strict=True) if policy not in table.bounds]
        best = _best(competing, name)
        columns.append(
            [
                _cell(interval_html(each, form), None, "best" if mean == best else "")
                for each, mean in zip(intervals, means, strict=True)
            ]
        )
    names, titles = list(table.names.values()), [title_of(name) for name in metrics]
    if len(metrics) > len(names):  # the longer list goes down: a page is not as wide
        return _table([("metric", "about"), *((name, "") for name in names)], _rows(titles, columns))
    by_policy = [[column[k] for column in columns] for k in range(len(names))]
    return _table([("policy", "about"), *((title, "") for title in titles)], _rows(names, by_policy))


def _rows(names: Sequence[str], cells: Sequence[Sequence[str]]) -> list[str]:
    return [
        f"<tr>{_cell(html.escape(name), None, 'about')}{''.join(row)}</tr>"
        for name, row in zip(names, cells, strict=True)
    ]


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> str:
    """Return a table of plain texts, its first `texts` columns left-aligned; empty without rows."""
    css = ["about"] * texts + [""] * (len(heads) - texts)
    lines = [
        f"<tr>{''.join(_cell(html.escape(text), None, name) for text, name in zip(row, css, strict=True))}</tr>"
        for row in rows
    ]
    return _table(list(zip(heads, css, strict=True)), lines) if rows else ""


def failures(table: ResultTable) -> str:
    """Return the failed runs with their tracebacks, folded; empty without any."""
    parts = []
    for result in table.failures:
        name = name_of_cell(result.cell, table.conditions)
        summary = f"{html.escape(name)}: <code>{html.escape((result.reason or '')[:200])}</code>"
        parts.append(f"<details><summary>{summary}</summary><pre>{html.escape(result.traceback or '')}</pre></details>")
    return "".join(parts)


def _best(shown: Sequence[str], metric: str) -> str | None:
    """Return the best text of a column; None where all look alike."""
    numbers = {text for text in shown if text != "-"}
    return (min if less_is_better(metric) else max)(numbers, key=_number) if len(numbers) > 1 else None


def _number(text: str) -> float:
    return float(text.replace(",", ""))


def _form(metric: str) -> str:
    """Return the format of a metric in tables; bytes get commas."""
    return f",{form_of(metric)}" if metric == BYTES else form_of(metric)


def interval_html(interval: Interval, form: str = ".1f") -> str:
    """Return a mean, followed by its interval where that is known."""
    beside = interval_beside(interval, form)
    mean = format_value(interval.mean, form)
    return f'{mean} <span class="dim">{beside}</span>' if beside else mean


def _state(entry: Standing, cells: int) -> str:
    faults = [f"{count} {word}" for count, word in ((entry.failed, "failed"), (entry.missing, "not run")) if count]
    done = cells - entry.failed - entry.missing
    return _cell(f"{done} of {cells}{', ' * bool(faults)}{', '.join(faults)}", done, "failed" * bool(faults))


def _span(entries: Sequence[Standing]) -> tuple[float, float]:
    """Return the range of the strips: all means and worst conditions, and intervals where they do not dwarf these."""
    known = [value for entry in entries for value in (entry.mean.mean, entry.worst) if not math.isnan(value)]
    if not known:
        return 0.0, 0.0
    low, high = min(known), max(known)
    margin = (high - low) / 3
    ends = [end for entry in entries for end in (entry.mean.low, entry.mean.high) if not math.isnan(end)]
    return max(low - margin, min([low, *ends])), min(high + margin, max([high, *ends]))


def _strip(entry: Standing, low: float, high: float, several: bool) -> str:
    width, height = _STRIP_PX
    middle, reach = height / 2, width - 12

    def place(value: float) -> str:
        share = 0.5 if high <= low else (value - low) / (high - low)
        return f"{6 + reach * min(max(share, 0.0), 1.0):.1f}"

    parts = []
    if not math.isnan(entry.mean.half_width):
        x1, x2 = place(entry.mean.low), place(entry.mean.high)
        parts.append(f'<line x1="{x1}" x2="{x2}" y1="{middle}" y2="{middle}"/>')
    if several and not math.isnan(entry.worst):
        parts.append(f'<circle class="hollow" cx="{place(entry.worst)}" cy="{middle}" r="3"/>')
    if not math.isnan(entry.mean.mean):
        parts.append(f'<circle cx="{place(entry.mean.mean)}" cy="{middle}" r="4"/>')
    return f'<svg class="strip" width="{width}" height="{height}" aria-hidden="true">{"".join(parts)}</svg>'


def _cell(inner: str, key: float | None = None, css: str = "") -> str:
    attributes = f' class="{css}"' if css else ""
    if key is not None:
        attributes += f' data-key="{key if math.isfinite(key) else ""}"'
    return f"<td{attributes}>{inner}</td>"


def _table(heads: Sequence[tuple[str, str]], rows: Sequence[str], sortable: bool = False) -> str:
    metrics = all_metrics()
    cells = []
    for name, css in heads:
        attributes = f' class="{css}"' if css else ""
        if name in metrics:
            attributes += f' title="{html.escape(metrics[name].definition)}"'
        text = html.escape(name)
        cells.append(f'<th scope="col"{attributes}>{f"<button>{text}</button>" if sortable else text}</th>')
    css = ' class="sortable"' if sortable else ""
    return (
        f'<div class="scroll" role="region" aria-label="table" tabindex="0"><table{css}>'
        f"<thead><tr>{''.join(cells)}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )
