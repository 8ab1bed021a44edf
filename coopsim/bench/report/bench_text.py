"""A benchmark's results as Markdown, to read, and as CSV, to compute with; tables of scores as plain text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from tabulate import tabulate

from coopsim.bench.evaluate import Evaluation
from coopsim.bench.grid.labels import label, name_of_cell, short_label
from coopsim.bench.report.formats import to_csv_text
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import standings
from coopsim.bench.results.statistics import Interval
from coopsim.metrics.built_in import BYTES, all_metrics, custom_metrics, is_yes_no
from coopsim.metrics.driving import DRIVING_SHOWN
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.metrics.score import GroupRecall, Score

METHODS_TITLE, COUNTS_TITLE = "Methods of the policies", "Counts over all runs"

LEAST_DISTURBED = "least disturbed"
"""Heading of values in the conditions that disturb least."""

METRICS_SHOWN = (
    *(PRIMARY_METRIC, "AMOTA", "MOTA", "MOTP", "HOTA", "IDF1", "APBEV@0.5", "IDS", "FP", "FN"),
    *DRIVING_SHOWN,
    *("ghosts_believed", "denied_lost", "attacker_TPR", "attacker_FPR"),
)
"""The built-in metrics that fit on a page."""


def to_markdown(table: ResultTable, title: str, metrics: Sequence[str] = ()) -> str:
    """Format the leaderboard and a table per condition.

    The first of `metrics` ranks; by default they are those of `METRICS_SHOWN` and of registered metrics that the
    results have. Raises `UnknownNameError` for a metric that they lack.
    """
    chosen = tuple(metrics) or _usual(table)
    parts = [f"# {escaped(title)}", leaderboard_text(table, metrics)]
    means = f"Mean over {len(table.conditions)} condition{'s' * (len(table.conditions) != 1)}"
    interval = f", ± half of its 95 % interval over {table.samples.text} ({interval_kinds(chosen)})"
    parts.append(means + (interval if table.samples.count > 1 else f" of {table.samples.text}") + ".")
    parts += [f"Networks multiply in {table.arithmetics[0]}."] if len(table.arithmetics) == 1 else []
    parts += [table.caution] if table.caution else []
    for k, condition in enumerate(table.conditions):
        parts.append(f"## {escaped(label(condition, table.conditions))}\n\n{_condition(table, k, chosen)}")
    below = {METHODS_TITLE: table.methods, COUNTS_TITLE: table.counted}
    for heading, texts in below.items():
        if texts:
            lines = [escaped(f"{policy}: {text}") for policy, text in texts.items()]
            parts.append(f"## {heading}\n\n" + "\n".join(f"- {line}" for line in lines))
    if table.failures:
        parts.append("## Failed runs\n\n" + "\n".join(_failures(table)))
    return "\n\n".join(parts) + "\n"


def leaderboard_text(table: ResultTable, metrics: Sequence[str] = ()) -> str:
    """Format the leaderboard alone; see `to_markdown`."""
    chosen = tuple(metrics) or _usual(table)
    return _leaderboard(table, chosen[0]) if chosen else "No run was finished."


def to_csv(table: ResultTable) -> str:
    """Format one row per cell, unrounded: the cell, whether it failed, all values, `messages_...` and `counts_...`."""
    counts = sorted({name for result in table.results for name in result.messages})
    counted = sorted({name for result in table.results for name in result.counts})
    drawn = any(result.place_seed is not None for result in table.results)
    rows: list[dict[str, Any]] = []
    for result in table.results:
        cell = result.cell
        rows.append(
            {
                "policy": cell.policy,
                **({"bound": result.bound} if table.bounds else {}),
                **table.columns(cell.condition),
                "seed": cell.seed,
                **({"place_seed": result.place_seed} if drawn else {}),
                "frames": cell.frames,
                "failed": result.failed,
                **{name: result.values.get(name) for name in table.metrics},
                **{f"messages_{name}": result.messages.get(name) for name in counts},
                **{f"counts_{name}": result.counts.get(name) for name in counted},
            }
        )
    return to_csv_text(rows)


def to_rows(table: ResultTable) -> list[dict[str, Any]]:
    """Return a row for each policy and condition: every metric's mean over seeds with its 95 % interval.

    Numbers that are not known, or are infinite, are None, as JSON has neither.
    """
    metrics = {name: table.values(name) for name in table.metrics}
    return [
        {
            "policy": policy,
            **_finite(table.columns(condition)),
            "metrics": {
                name: _finite({key: asdict(table.interval(name, values[p, c]))[key] for key in ("mean", "low", "high")})
                for name, values in metrics.items()
            },
        }
        for p, policy in enumerate(table.policies)
        for c, condition in enumerate(table.conditions)
    ]


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    known = {name for name, each in values.items() if not isinstance(each, float) or math.isfinite(each)}
    return {name: each if name in known else None for name, each in values.items()}


def _usual(table: ResultTable) -> tuple[str, ...]:
    fitting = {*METRICS_SHOWN, *custom_metrics()}.intersection(table.shown)
    first = table.shown[:1] if fitting.intersection(table.shown[:1]) else ()
    named = (*first, *METRICS_SHOWN, *custom_metrics())
    return tuple(name for name in dict.fromkeys(named) if name in fitting) or table.shown


def _leaderboard(table: ResultTable, metric: str) -> str:
    several = len(table.conditions) > 1
    disturbed = [LEAST_DISTURBED, "worst", "with"] if several else []
    heads = ["rank", "policy", metric, *disturbed, BYTES_TITLE, "failed", "not run"]
    form = form_of(metric)
    rows = []
    for entry in standings(table, metric):
        where = "-" if entry.worst_condition is None else short_label(entry.worst_condition, table.conditions)
        worst = [format_value(entry.undisturbed, form), format_value(entry.worst, form), escaped(where)]
        rows.append(
            [
                "-" if entry.rank is None else str(entry.rank),
                escaped(table.names[entry.policy]),
                _interval(entry.mean, form),
                *(worst if several else []),
                format_value(entry.bytes_per_s, form_of(BYTES)),
                str(entry.failed),
                str(entry.missing),
            ]
        )
    align = ["left" if name in ("policy", "with") else "right" for name in heads]
    return tabulate(rows, heads, tablefmt="github", colalign=align, disable_numparse=True)


def _condition(table: ResultTable, condition: int, metrics: Sequence[str]) -> str:
    names = [*metrics, *([BYTES] if BYTES in table.metrics else [])]
    columns = [
        [_interval(table.interval(name, seeds), form_of(name)) for seeds in table.values(name)[:, condition]]
        for name in names
    ]
    rows = [[escaped(name), *(each[k] for each in columns)] for k, name in enumerate(table.names.values())]
    heads = ["policy", *map(title_of, names)]
    align = ["left", *["right"] * len(names)]
    return tabulate(rows, heads, tablefmt="github", colalign=align, disable_numparse=True)


def _failures(table: ResultTable) -> list[str]:
    failed = [f"{name_of_cell(each.cell, table.conditions)}: {each.reason}" for each in table.failures]
    return [f"- {escaped(line)}" for line in failed]


def _interval(interval: Interval, form: str) -> str:
    return " ".join(part for part in (format_value(interval.mean, form), interval_beside(interval, form)) if part)


def interval_kinds(metrics: Sequence[str]) -> str:
    """Return the methods of the intervals of some metrics, in words."""
    return "Student's t" + "; of rates, in brackets, Wilson's" * any(is_yes_no(name) for name in metrics)


def interval_beside(interval: Interval, form: str, plus_minus: str = "±") -> str:
    """Return an interval as it stands beside its mean: "± 1.2", or "(0.3 to 4.0)" of a rate; empty if not known."""
    if math.isnan(interval.half_width):
        return ""
    if interval.is_rate:
        return f"({format_value(interval.low, form)} to {format_value(interval.high, form)})"
    return f"{plus_minus} {format_value(interval.half_width, form)}"


def escaped(text: str) -> str:
    """Escape Markdown, and keep the text on one line."""
    for letter in "\\&`*[]<>|":
        text = text.replace(letter, f"\\{letter}")
    return " ".join(text.split())


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> str:
    """Format a table of Markdown, its first `texts` columns left-aligned."""
    align = ["left"] * texts + ["right"] * (len(heads) - texts)
    cells = [[escaped(cell) for cell in row] for row in rows]
    named = [escaped(head) for head in heads]
    return tabulate(cells, named, tablefmt="github", colalign=align, disable_numparse=True) if rows else ""


def difference_text(interval: Interval, form: str) -> str:
    """Format a mean difference with its interval, if that has finite ends."""
    mean = format_value(interval.mean, f"+{form}")
    if not np.isfinite([interval.low, interval.high]).all():
        return mean
    return f"{mean} ({interval.low:+{form}} to {interval.high:+{form}})"


BYTES_TITLE, FRAMES_TITLE = "bytes/s", "frames/s"

COLUMNS: tuple[tuple[str, str], ...] = (
    (PRIMARY_METRIC, ".1f"),
    ("AMOTA", ".1f"),
    ("AMOTP", ".1f"),
    ("MOTA", ".1f"),
    ("MOTP", ".1f"),
    ("IDS", ".1f"),
    ("FP", ".0f"),
    ("FN", ".0f"),
    (BYTES_TITLE, ".0f"),
    (FRAMES_TITLE, ".1f"),
)
"""Titles and formats of the built-in columns. Percentages, except counts and rates."""


def columns() -> tuple[tuple[str, str], ...]:
    """Return the titles and formats of all columns: `COLUMNS`, with registered metrics before the rates."""
    custom = ((name, metric.form) for name, metric in custom_metrics().items())
    return (*COLUMNS[:-2], *custom, *COLUMNS[-2:])


def title_of(metric: str) -> str:
    """Return a metric's name as tables show it."""
    return BYTES_TITLE if metric == BYTES else metric


def form_of(metric: str) -> str:
    """Return the format of a metric's values in reports, one digit for a metric that is not registered."""
    metrics = all_metrics()
    return metrics[metric].form if metric in metrics else ".1f"


def format_value(value: float, form: str) -> str:
    """Format a value; NaN is a dash."""
    return "-" if math.isnan(value) else format(value, form)


def format_p_value(value: float) -> str:
    """Format a p-value with three digits; a smaller one is below the smallest that they show."""
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def score_row(score: Score, frames_per_s: float) -> dict[str, float]:
    """Return a score's values by column; NaN where the score has none."""
    values = {**score.values, BYTES_TITLE: score[BYTES], FRAMES_TITLE: frames_per_s}
    return {title: values.get(title, math.nan) for title, _ in columns()}


def evaluation_row(evaluation: Evaluation) -> dict[str, float]:
    """Return an evaluation's values by column."""
    return score_row(evaluation.score, evaluation.frames_per_s)


def format_table(rows: Sequence[tuple[Mapping[str, str], Mapping[str, float]]]) -> str:
    """Format rows as aligned plain text: headings with texts, the same in every row, and values by column."""
    if not rows:
        return "no results"
    shown = columns()
    headings = [*rows[0][0], *(title for title, _ in shown)]
    cells = [
        [*about.values(), *(format_value(values.get(title, math.nan), form) for title, form in shown)]
        for about, values in rows
    ]
    return _aligned(cells, headings, len(rows[0][0]))


def format_visibility(rows: Sequence[tuple[Mapping[str, str], Mapping[str, GroupRecall]]]) -> str:
    """Format recall by which agents saw an object, and the cooperative gain, for rows of texts and `Score.visibility`.

    The gain is the addition of objects that only other agents saw to the recall of all. Rows without groups are left
    out.
    """
    known = [(about, groups) for about, groups in rows if groups]
    if not known:
        return "it is not known which agents saw what"
    names = [name for name in known[0][1] if any(groups[name].gt for _, groups in known)]
    headings = [*known[0][0], *(part for name in names for part in (f"seen by {name}", "recall")), "cooperative gain"]
    cells = []
    for about, groups in known:
        numbers = [value for name in names for value in (groups[name].share, groups[name].recall)]
        numbers.append(groups["others only"].gain)
        cells.append([*about.values(), *(format_value(value, ".1f") for value in numbers)])
    return _aligned(cells, headings, len(known[0][0]))


def _aligned(cells: Sequence[Sequence[str]], headings: Sequence[str], texts: int) -> str:
    """Align the first `texts` columns left and the numbers right."""
    align = ["left"] * texts + ["right"] * (len(headings) - texts)
    return tabulate(cells, headers=headings, colalign=align, disable_numparse=True)
