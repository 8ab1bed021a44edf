"""The plain-text table that `demo`, `replay` and `leaderboard` print."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tabulate import tabulate

from coopsim.bench.evaluate import Evaluation
from coopsim.metrics.built_in import BYTES, all_metrics, custom_metrics
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.metrics.score import GroupRecall, Score

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


def score_row(score: Score, frames_per_s: float) -> dict[str, float]:
    """Return a score's values by column; NaN where the score has none."""
    values = {**score.values, BYTES_TITLE: score[BYTES], FRAMES_TITLE: frames_per_s}
    return {title: values.get(title, math.nan) for title, _ in columns()}


def evaluation_row(evaluation: Evaluation) -> dict[str, float]:
    """Return an evaluation's values by column."""
    return score_row(evaluation.score, evaluation.frames_per_s)


def format_table(rows: Sequence[tuple[Mapping[str, str], Mapping[str, float]]]) -> str:
    """Format rows as aligned plain text.

    Args:
        rows: per row what it is about (heading to text; the same headings in every row) and its values by column.
    """
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
    """Format recall by which agents saw an object, and the cooperative gain.

    The gain is what objects that only other agents saw add to the recall of all.

    Args:
        rows: per row what it is about (heading to text; the same headings in every row) and `Score.visibility`; rows
            where that is empty are left out.
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
