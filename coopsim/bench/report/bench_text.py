"""A benchmark's results as Markdown, to read, and as CSV, to compute with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from tabulate import tabulate

from coopsim.bench.grid.axes import label, short_label
from coopsim.bench.report.formats import to_csv_text
from coopsim.bench.report.table import BYTES_TITLE, form_of, format_value, title_of
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import standings
from coopsim.bench.results.statistics import Interval
from coopsim.metrics.built_in import BYTES, custom_metrics
from coopsim.metrics.metric import PRIMARY_METRIC

METRICS_SHOWN = (PRIMARY_METRIC, "AMOTA", "MOTA", "MOTP", "HOTA", "IDF1", "APBEV@0.5", "IDS", "FP", "FN")
"""The built-in metrics that fit on a page."""


def to_markdown(table: ResultTable, title: str, metrics: Sequence[str] = ()) -> str:
    """Format the leaderboard and a table per condition.

    Args:
        table: the results.
        title: of the document.
        metrics: of the tables, the first one ranks; default: those of `METRICS_SHOWN` and of registered metrics that
            the results have.

    Raises:
        UnknownNameError: the results have no such metric.
    """
    chosen = tuple(metrics) or _usual(table)
    parts = [f"# {_escaped(title)}", leaderboard_text(table, metrics)]
    means = f"Mean over {len(table.conditions)} condition{'s' * (len(table.conditions) != 1)}"
    interval = f", ± half of its 95 % interval over {table.samples.text} (Student's t)"
    parts.append(means + (interval if table.samples.count > 1 else f" of {table.samples.text}") + ".")
    parts += [f"Networks multiply in {table.arithmetics[0]}."] if len(table.arithmetics) == 1 else []
    parts += [table.caution] if table.caution else []
    for k, condition in enumerate(table.conditions):
        parts.append(f"## {_escaped(label(condition, table.conditions))}\n\n{_condition(table, k, chosen)}")
    below = {"What stands behind the rows": table.methods, "Counted by policies in all cells": table.counted}
    for heading, texts in below.items():
        if texts:
            lines = [_escaped(f"{policy}: {text}") for policy, text in texts.items()]
            parts.append(f"## {heading}\n\n" + "\n".join(f"- {line}" for line in lines))
    if table.failures:
        parts.append("## Failed cells\n\n" + "\n".join(_failures(table)))
    return "\n\n".join(parts) + "\n"


def leaderboard_text(table: ResultTable, metrics: Sequence[str] = ()) -> str:
    """Format the leaderboard alone; the arguments and errors are those of `to_markdown`."""
    chosen = tuple(metrics) or _usual(table)
    return _leaderboard(table, chosen[0]) if chosen else "No cell was finished."


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
                **asdict(cell.condition),
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


def _usual(table: ResultTable) -> tuple[str, ...]:
    return tuple(name for name in (*METRICS_SHOWN, *custom_metrics()) if name in table.shown) or table.shown


def _leaderboard(table: ResultTable, metric: str) -> str:
    several = len(table.conditions) > 1
    disturbed = ["undisturbed", "worst", "in"] if several else []
    heads = ["rank", "policy", metric, *disturbed, BYTES_TITLE, "failed", "not run"]
    form = form_of(metric)
    rows = []
    for entry in standings(table, metric):
        where = "-" if entry.worst_condition is None else short_label(entry.worst_condition, table.conditions)
        worst = [format_value(entry.undisturbed, form), format_value(entry.worst, form), _escaped(where)]
        rows.append(
            [
                "-" if entry.rank is None else str(entry.rank),
                _escaped(entry.policy),
                _interval(entry.mean, form),
                *(worst if several else []),
                format_value(entry.bytes_per_s, form_of(BYTES)),
                str(entry.failed),
                str(entry.missing),
            ]
        )
    align = ["left" if name in ("policy", "in") else "right" for name in heads]
    return tabulate(rows, heads, tablefmt="github", colalign=align, disable_numparse=True)


def _condition(table: ResultTable, condition: int, metrics: Sequence[str]) -> str:
    names = [*metrics, *([BYTES] if BYTES in table.metrics else [])]
    columns = [
        [_interval(table.samples.interval(seeds), form_of(name)) for seeds in table.values(name)[:, condition]]
        for name in names
    ]
    rows = [[_escaped(policy), *(each[k] for each in columns)] for k, policy in enumerate(table.policies)]
    heads = ["policy", *map(title_of, names)]
    align = ["left", *["right"] * len(names)]
    return tabulate(rows, heads, tablefmt="github", colalign=align, disable_numparse=True)


def _failures(table: ResultTable) -> list[str]:
    lines = []
    for result in table.failures:
        cell = result.cell
        where = label(cell.condition, table.conditions)
        lines.append("- " + _escaped(f"{cell.policy}, {where}, seed {cell.seed}: {result.reason}"))
    return lines


def _interval(interval: Interval, form: str) -> str:
    half = interval.half_width
    return format_value(interval.mean, form) + ("" if math.isnan(half) else f" ± {format_value(half, form)}")


def _escaped(text: str) -> str:
    """Escape Markdown, and keep the text on one line."""
    for letter in "\\&`*[]<>|":
        text = text.replace(letter, f"\\{letter}")
    return " ".join(text.split())
