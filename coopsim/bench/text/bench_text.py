"""A benchmark's results as Markdown, to read, and as CSV, to compute with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from tabulate import tabulate

from coopsim.bench.grid.labels import label, name_of_cell, short_label
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import standings
from coopsim.bench.results.statistics import Interval
from coopsim.bench.text.forms import (
    BYTES_TITLE,
    escaped,
    form_of,
    format_value,
    interval_beside,
    interval_kinds,
    markdown_table,
    title_of,
    to_csv_text,
)
from coopsim.metrics.built_in import BYTES, custom_metrics
from coopsim.metrics.driving import DRIVING_SHOWN
from coopsim.metrics.metric import PRIMARY_METRIC

METHODS_TITLE, COUNTS_TITLE = "Methods of the policies", "Counts over all runs"

CLEAN, WORST_CONDITION = "clean", "worst condition"
"""Headings of values where nothing disturbs, or as little as was run, and of where a policy is worst."""

METRICS_SHOWN = (
    *(PRIMARY_METRIC, "AMOTA", "MOTA", "MOTP", "HOTA", "IDF1", "APBEV@0.5", "IDS", "FP", "FN"),
    *DRIVING_SHOWN,
    *("ghosts_believed", "denied_lost", "attacker_TPR", "attacker_FPR"),
)
"""The built-in metrics that fit on a page."""


def to_markdown(table: ResultTable, title: str, metrics: Sequence[str] = (), verdict: str = "") -> str:
    """Format the leaderboard and a table per condition, below a title and a sentence with the answer, if there is one.

    The first of `metrics` ranks; by default they are those of `METRICS_SHOWN` and of registered metrics that the
    results have. Raises `UnknownNameError` for a metric that they lack.
    """
    chosen = tuple(metrics) or _usual(table)
    parts = [f"# {escaped(title)}", *([escaped(verdict)] if verdict else []), leaderboard_text(table, metrics)]
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
    disturbed = [CLEAN, "worst", WORST_CONDITION] if several else []
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
    align = ["left" if name in ("policy", WORST_CONDITION) else "right" for name in heads]
    return tabulate(rows, heads, tablefmt="github", colalign=align, disable_numparse=True)


def _condition(table: ResultTable, condition: int, metrics: Sequence[str]) -> str:
    names = [*metrics, *([BYTES] if BYTES in table.metrics else [])]
    columns = [
        [_interval(table.interval(name, seeds), form_of(name)) for seeds in table.values(name)[:, condition]]
        for name in names
    ]
    rows = [[name, *(each[k] for each in columns)] for k, name in enumerate(table.names.values())]
    return markdown_table(["policy", *map(title_of, names)], rows)


def _failures(table: ResultTable) -> list[str]:
    failed = [f"{name_of_cell(each.cell, table.conditions)}: {each.reason}" for each in table.failures]
    return [f"- {escaped(line)}" for line in failed]


def _interval(interval: Interval, form: str) -> str:
    return " ".join(part for part in (format_value(interval.mean, form), interval_beside(interval, form)) if part)
