"""Scores of single runs as rows, and as plain text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tabulate import tabulate

from coopsim.bench.evaluate import Evaluation
from coopsim.bench.text.forms import BYTES_TITLE, FRAMES_TITLE, columns, format_value
from coopsim.metrics.built_in import BYTES
from coopsim.metrics.score import GroupRecall, Score


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
