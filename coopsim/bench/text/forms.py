"""Forms of values, intervals and tables in texts of any kind."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from tabulate import tabulate

from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.results.statistics import Interval
from coopsim.metrics.built_in import BYTES, all_metrics, custom_metrics, is_yes_no
from coopsim.metrics.metric import PRIMARY_METRIC

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


def name_of(metric: str) -> str:
    """Return a metric's name for the axis of a chart, with the unit of a rate."""
    return f"{metric} (% of episodes)" if is_yes_no(metric) else metric


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


@dataclass(frozen=True, slots=True)
class TextTable:
    """Table of texts, of which the first `texts` columns are left-aligned."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    texts: int = 1

    def markdown(self) -> str:
        """Return the table as Markdown; empty without rows."""
        return markdown_table(self.heads, self.rows, self.texts)


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> str:
    """Format a table of Markdown, its first `texts` columns left-aligned."""
    align = ["left"] * texts + ["right"] * (len(heads) - texts)
    cells = [[escaped(cell) for cell in row] for row in rows]
    named = [escaped(head) for head in heads]
    return tabulate(cells, named, tablefmt="github", colalign=align, disable_numparse=True) if rows else ""


def difference_text(interval: Interval, form: str) -> str:
    """Format a mean difference with its interval, if that has finite ends; -0 is +0."""
    mean = format_value(interval.mean, f"+z{form}")
    if not np.isfinite([interval.low, interval.high]).all():
        return mean
    return f"{mean} ({interval.low:+z{form}} to {interval.high:+z{form}})"


def to_csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows as CSV, with a heading; all rows have the names of the first. No rows give an empty text."""
    if not rows:
        return ""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def mean_cells(table: ResultTable, metrics: Sequence[str], policy: int, conditions: Sequence[int]) -> list[str]:
    """Format a policy's means in some conditions, a metric each; empty where none is known."""
    values = [table.values(name)[policy, conditions].reshape(1, -1) for name in metrics]
    means = [float(known_mean(each, axis=1)[0]) for each in values]
    known = not all(map(math.isnan, means))
    return [format_value(mean, form_of(name)) for mean, name in zip(means, metrics, strict=True)] if known else []


def sections_text(title: str, parts: Iterable[tuple[str, str, str]]) -> str:
    """Format a page of Markdown from headings, contents and notes; parts without content are left out."""
    shown = [f"## {heading}\n\n{note}\n\n{content}" for heading, content, note in parts if content]
    return f"# {title}\n\n" + "\n\n".join(shown) + "\n"
