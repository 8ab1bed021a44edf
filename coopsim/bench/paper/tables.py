"""Tables of a benchmark for papers: LaTeX with booktabs, and means with intervals and significance as CSV.

In LaTeX the best value is bold, and a star marks what it does not beat significantly.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from coopsim.bench.grid.axis import Axis
from coopsim.bench.grid.cell import Condition
from coopsim.bench.grid.labels import mildest, mildest_along, varying_axes
from coopsim.bench.results.result_table import ResultTable, known_mean, named
from coopsim.bench.results.standings import BestComparison, compare_with_best
from coopsim.bench.results.statistics import LEVEL, seeds_needed, smallest_p_value
from coopsim.bench.text.forms import BYTES_TITLE, form_of, format_value, interval_beside, to_csv_text
from coopsim.config.spec import parse_spec
from coopsim.metrics.built_in import BYTES, less_is_better


def short_names(table: ResultTable) -> dict[str, str]:
    """Return a short name of each policy: without parameters and file, where no other one is then called alike."""
    bare = {policy: _bare(policy) for policy in table.policies}
    count = Counter(bare.values())
    short = {policy: policy if count[name] > 1 and policy != name else name for policy, name in bare.items()}
    return {policy: named(name, bound=policy in table.bounds) for policy, name in short.items()}


def _bare(policy: str) -> str:
    return parse_spec("policy", policy)[0].rpartition(":")[2]


_LETTERS = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", "°": r"$^\circ$", "±": r"$\pm$",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Column:
    """Column of a table: a metric in some conditions."""

    title: str
    metric: str
    conditions: tuple[int, ...]


def latex_tables(table: ResultTable, metrics: Sequence[str]) -> dict[str, str]:
    """Format tables as LaTeX, by file name: `undisturbed.tex`, and `METRIC_AXIS.tex` for every axis that varies.

    The first has all metrics and bytes per second in the mildest conditions, the others the first metric at every value
    of an axis, with all other axes at their mildest value. Values are means over scenarios. A document needs the
    package `booktabs`.
    """
    calm = tuple(table.conditions.index(each) for each in mildest(table.conditions))
    shown = (*metrics, *([BYTES] if BYTES in table.metrics else []))
    titles = {BYTES: BYTES_TITLE}
    columns = [_Column(titles.get(metric, metric), metric, calm) for metric in shown]
    found = {"undisturbed.tex": _table(table, columns, "Without disturbance", "undisturbed")} if calm else {}
    for axis in varying_axes(table.conditions):
        name = f"{metrics[0]}_{axis.title.replace(' ', '_')}"
        found[f"{name}.tex"] = _table(table, _by_axis(table, metrics[0], axis), f"{metrics[0]} by {axis.title}", name)
    return found


def _by_axis(table: ResultTable, metric: str, axis: Axis) -> list[_Column]:
    """Return a column for each value of an axis, the mildest first."""
    places: dict[float | str, list[int]] = {}
    texts: dict[float | str, str] = {}
    for k in mildest_along(axis, table.conditions):
        condition = table.conditions[k]
        places.setdefault(axis.value(condition), []).append(k)
        texts[axis.value(condition)] = axis.text(condition)
    return [_Column(texts[value], metric, tuple(places[value])) for value in sorted(places, key=axis.harm)]


def _table(table: ResultTable, columns: Sequence[_Column], heading: str, label: str) -> str:
    compared = [
        None if each.metric == BYTES else compare_with_best(table, each.metric, each.conditions) for each in columns
    ]
    texts = [
        _rates(table, column) if entries is None else [_cell(entry, form_of(column.metric)) for entry in entries]
        for column, entries in zip(columns, compared, strict=True)
    ]
    names = short_names(table)
    order = _order(columns, compared, len(table.policies))
    lines = [" & ".join([escape(names[table.policies[k]]), *(column[k] for column in texts)]) + r" \\" for k in order]
    heads = " & ".join(["policy", *(escape(column.title) for column in columns)])
    known = [entries for entries in compared if entries is not None]
    return "\n".join(
        [
            r"\begin{table}",
            r"  \centering\footnotesize\setlength{\tabcolsep}{4pt}",
            f"  \\caption{{{escape(heading)} ({escape(', '.join(table.scenarios))}), {_legend(table, known)}}}",
            f"  \\label{{tab:{label.replace('_', '-')}}}",
            f"  \\begin{{tabular}}{{l{'r' * len(columns)}}}",
            r"    \toprule",
            f"    {heads} \\\\",
            r"    \midrule",
            *(f"    {line}" for line in lines),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def _legend(table: ResultTable, compared: Sequence[Sequence[BestComparison]]) -> str:
    """Return what a caption says of numbers and marks."""
    samples = table.samples
    parts = [f"mean over {escape(samples.text)}"]
    if samples.count > 1:
        rates = any(entry.interval.is_rate for entries in compared for entry in entries)
        kinds = "Student's t" + "; of rates, in brackets, Wilson's" * rates
        parts[0] += rf" $\pm$ half of the 95\,\% interval ({kinds})"
    if any(entry.best for entries in compared for entry in entries):
        tests = "sign flips, by the largest difference of any two policies of a column"
        parts.append(f"the best in bold, and $^*$ what it does not beat significantly ($p > {LEVEL:g}$; {tests})")
    several = any(sum(entry.complete for entry in entries) > 1 for entries in compared)
    if several and samples.count and smallest_p_value(samples.count) > LEVEL:
        few = escape(samples.text)
        parts.append(f"none can be significantly better with {few}: it takes {seeds_needed(1)}")
    if any(not entry.complete and entry.interval.count for entries in compared for entry in entries):
        parts.append("in brackets what lacks runs, and is not compared")
    return "; ".join(parts) + "."


def _order(columns: Sequence[_Column], compared: Sequence[Sequence[BestComparison] | None], count: int) -> list[int]:
    """Return the order of the rows: by the first metric, the best first, and those that lack runs last."""
    for column, entries in zip(columns, compared, strict=True):
        if entries is not None:
            sign = 1.0 if less_is_better(column.metric) else -1.0
            keys = [(not each.complete, _known(sign * each.interval.mean)) for each in entries]
            return sorted(range(count), key=keys.__getitem__)
    return list(range(count))


def _known(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _rates(table: ResultTable, column: _Column) -> list[str]:
    values = table.values(BYTES)[:, list(column.conditions)]
    intervals = [table.interval(BYTES, row) for row in known_mean(values, axis=1)]
    return [format_value(each.mean, ",.0f").replace(",", r"\,") for each in intervals]


def _cell(entry: BestComparison, form: str) -> str:
    """Format a mean with its interval: the best in bold, what it does not beat with a star."""
    mean, found = _number(entry.interval.mean, form), interval_beside(entry.interval, form, r"$\pm$")
    beside = rf" {{\scriptsize{found}}}" if found else ""
    if entry.best:
        return rf"\textbf{{{mean}}}{beside}"
    if not entry.complete and entry.interval.count:
        return f"({mean}{beside})"
    return mean + beside + r"\rlap{$^*$}" * entry.unbeaten


def _number(value: float, form: str) -> str:
    """Format a number; its sign is a minus, not a hyphen."""
    text = format_value(value, form)
    return f"${text}$" if text.startswith("-") and text != "-" else text


def escape(text: str) -> str:
    """Return a text as LaTeX shows it, on one line."""
    return " ".join("".join(_LETTERS.get(letter, letter) for letter in text).split())


def interval_csv(table: ResultTable, metrics: Sequence[str]) -> str:
    """Format a CSV row per condition, metric and policy, unrounded; rows without a scenario are over all conditions.

    `low` and `high` are the ends of the 95 % interval of the mean over `samples` seeds or places; empty where they are
    not known. `p_to_best` is the corrected p-value of the difference to the best policy of that condition and metric;
    empty for the best one, and for a policy that is not `complete`.
    """
    every = tuple(range(len(table.conditions)))
    groups: list[tuple[Condition | None, tuple[int, ...]]] = [(None, every)] if len(every) > 1 else []
    groups += [(condition, (k,)) for k, condition in enumerate(table.conditions)]
    rows: list[dict[str, Any]] = []
    for condition, numbers in groups:
        where = table.columns(condition)
        for metric in metrics:
            for policy, entry in zip(table.policies, compare_with_best(table, metric, numbers), strict=True):
                rows.append(
                    {
                        "policy": policy,
                        **({"bound": policy in table.bounds} if table.bounds else {}),
                        **where,
                        "metric": metric,
                        "mean": _or_none(entry.interval.mean),
                        "low": _or_none(entry.interval.low),
                        "high": _or_none(entry.interval.high),
                        "samples": entry.interval.count,
                        "complete": entry.complete,
                        "best": entry.best,
                        "p_to_best": _or_none(entry.p_corrected),
                    }
                )
    return to_csv_text(rows)


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
