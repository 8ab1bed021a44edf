"""The one table that every command prints, and the report shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tabulate import tabulate

from coopsim.bench.evaluate import Evaluation
from coopsim.bench.report.metric_names import BYTES, BYTES_SHOWN
from coopsim.metrics.recall_by_visibility import GroupRecall
from coopsim.metrics.score import Score

COLUMNS: tuple[tuple[str, str], ...] = (
    ("sAMOTA", ".1f"),
    ("AMOTA", ".1f"),
    ("AMOTP", ".1f"),
    ("MOTA", ".1f"),
    ("MOTP", ".1f"),
    ("IDS", ".1f"),
    ("FP", ".0f"),
    ("FN", ".0f"),
    (BYTES_SHOWN, ".0f"),
    ("frames/s", ".1f"),
)
"""Columns and their formats. Percentages, except counts and rates."""


def format_value(value: float, form: str) -> str:
    """A value as both tables show it; a dash where there is none (not a number)."""
    return "-" if math.isnan(value) else format(value, form)


def score_row(score: Score, frames_per_s: float) -> dict[str, float]:
    """A score's values by column name."""
    rates = {BYTES_SHOWN: score[BYTES], "frames/s": frames_per_s}
    return {name: rates[name] if name in rates else score[name] for name, _ in COLUMNS}


def evaluation_row(evaluation: Evaluation) -> dict[str, float]:
    """An evaluation's values by column name."""
    return score_row(evaluation.score, evaluation.frames_per_s)


def format_table(rows: Sequence[tuple[Mapping[str, str], Mapping[str, float]]]) -> str:
    """Aligned plain text.

    Args:
        rows: per row what it is about (heading to text; the same headings in every row) and its values.
    """
    if not rows:
        return "no results"
    headings = [*rows[0][0], *(name for name, _ in COLUMNS)]
    cells = [[*about.values(), *(format_value(values[name], form) for name, form in COLUMNS)] for about, values in rows]
    align = ["left"] * len(rows[0][0]) + ["right"] * len(COLUMNS)
    return tabulate(cells, headers=headings, colalign=align, disable_numparse=True)


def format_visibility(rows: Sequence[tuple[Mapping[str, str], Mapping[str, GroupRecall]]]) -> str:
    """Recall by who saw an object, and the cooperative gain: what objects that only others saw add to all recall.

    Args:
        rows: per row what it is about (heading to text; the same headings in every row) and `Score.visibility`; rows
            where that is not known are left out.
    """
    known = [(about, groups) for about, groups in rows if groups]
    if not known:
        return "who saw what is not known"
    names = [name for name in known[0][1] if any(groups[name].gt for _, groups in known)]
    headings = [*known[0][0], *(part for name in names for part in (f"seen by {name}", "recall")), "cooperative gain"]
    cells = []
    for about, groups in known:
        numbers = [value for name in names for value in (groups[name].share, groups[name].recall)]
        numbers.append(groups["others only"].gain)
        cells.append([*about.values(), *(format_value(value, ".1f") for value in numbers)])
    align = ["left"] * len(known[0][0]) + ["right"] * (len(headings) - len(known[0][0]))
    return tabulate(cells, headers=headings, colalign=align, disable_numparse=True)
