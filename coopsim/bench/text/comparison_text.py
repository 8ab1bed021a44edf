"""A comparison as text, JSON and CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from tabulate import tabulate

from coopsim.bench.grid.cell import Condition, columns_of, further_options
from coopsim.bench.grid.labels import label
from coopsim.bench.results.comparison import Comparison, Difference
from coopsim.bench.results.statistics import LEVEL, seeds_needed, smallest_p_value
from coopsim.bench.text.forms import format_p_value, to_csv_text

_UNMATCHED_SHOWN = 10
_WORDS = {
    "better": "B is better",
    "worse": "B is worse",
    "identical": "A and B are identical",
}
_HEADINGS = ("policy", "condition", "metric", "A", "B", "B - A", "95 % interval", "p", "p corrected", "verdict")


def to_text(comparison: Comparison) -> str:
    """Format a comparison for a terminal: findings in words, the table, unmatched cells, and the method."""
    conditions = _conditions(comparison)
    rows = [
        [
            row.policy,
            _condition(row, conditions),
            row.metric,
            f"{row.before:.4g}",
            f"{row.after:.4g}",
            f"{row.change.mean:+.3g}",
            _interval(row),
            format_p_value(row.p_value),
            format_p_value(row.p_corrected),
            row.verdict,
        ]
        for row in comparison.differences
    ]
    align = ["right" if name in ("A", "B", "B - A", "p", "p corrected") else "left" for name in _HEADINGS]
    table = tabulate(rows, _HEADINGS, colalign=align, disable_numparse=True)
    parts = ["\n".join(_findings(comparison)), table, "\n".join(_unmatched(comparison)), "\n".join(_method(comparison))]
    return "\n\n".join(part for part in parts if part)


def to_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Return a flat row per difference, unrounded; unknown ends of an interval are None."""
    further = further_options(_conditions(comparison))
    return [
        {
            "policy": row.policy,
            **{name: _plain(value) for name, value in columns_of(row.condition, further).items()},
            "metric": row.metric,
            "a": row.before,
            "b": row.after,
            "difference": row.change.mean,
            "low": _plain(row.change.low),
            "high": _plain(row.change.high),
            "seeds": row.change.count,
            "p_bootstrap": _plain(row.p_bootstrap),
            "p_sign_flip": row.p_sign_flip,
            "p_corrected": row.p_corrected,
            "p_possible": row.p_possible,
            "significant": row.significant,
            "verdict": row.verdict,
        }
        for row in comparison.differences
    ]


def to_dict(comparison: Comparison) -> dict[str, Any]:
    """Return plain data for JSON; a row of `differences` whose scenario is None is over all conditions."""
    return {
        "differences": to_rows(comparison),
        "pairs": comparison.matched,
        "unmatched": list(comparison.unmatched),
        "comparisons": comparison.compared,
        "seeds_needed": _needed(comparison, max(comparison.compared, 1)),
        "level": LEVEL,
    }


def to_csv(comparison: Comparison) -> str:
    """Format the rows as CSV; a row without scenario is over all conditions."""
    return to_csv_text(to_rows(comparison))


def _plain(value: str | float) -> str | float | None:
    """Replace infinity, which JSON does not have, by None."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _needed(comparison: Comparison, count: int) -> int | None:
    """Return the seeds needed for one of `count` comparisons; those of rates can always have enough."""
    return seeds_needed(count, is_rate=all(row.is_rate for row in comparison.differences))


def _conditions(comparison: Comparison) -> tuple[Condition, ...]:
    return tuple(sorted({row.condition for row in comparison.differences if row.condition is not None}))


def _condition(row: Difference, conditions: Sequence[Condition]) -> str:
    return "all" if row.condition is None else label(row.condition, conditions)


def _findings(comparison: Comparison) -> list[str]:
    """Write a sentence for each policy and metric: over all conditions, and the number of significant ones."""
    conditions = _conditions(comparison)
    lines = []
    for policy, metric in dict.fromkeys((row.policy, row.metric) for row in comparison.differences):
        rows = [row for row in comparison.differences if (row.policy, row.metric) == (policy, metric)]
        first = rows[0]
        finding = _finding(comparison, first)
        where = "over all conditions" if first.condition is None else _condition(first, conditions)
        p_value = format_p_value(first.p_corrected)
        change = f"{first.change.mean:+.3g}, 95 % interval {_interval(first)}, corrected p {p_value}"
        line = f"{policy}, {metric}, {where}: {finding} (B - A = {change})."
        each = [row for row in rows if row.condition is not None]
        better, worse = (sum(row.verdict == name for row in each) for name in ("better", "worse"))
        if len(each) > 1 and better + worse:
            line += f" Of {len(each)} conditions, B is better in {better}, worse in {worse}."
        lines.append(line)
    return lines


def _finding(comparison: Comparison, row: Difference) -> str:
    """Return the verdict on a row in words."""
    if row.verdict in _WORDS:
        return _WORDS[row.verdict]
    count, kind = comparison.compared, comparison.samples.kind
    several = f" for {count} comparisons" * (count > 1)
    if row.verdict == "too few seeds":
        needed = seeds_needed(count, is_rate=row.is_rate)
        return f"too few {kind}{several} ({'no number is enough' if needed is None else f'{needed} needed'})"
    apart = not row.change.low <= 0 <= row.change.high
    return f"not significant after correction{several}" if apart and several else "no significant difference"


def _unmatched(comparison: Comparison) -> list[str]:
    unmatched = comparison.unmatched
    if not unmatched:
        return []
    shown = [f"  {line}" for line in unmatched[:_UNMATCHED_SHOWN]]
    rest = len(unmatched) - len(shown)
    return [f"Left out ({len(unmatched)}):", *shown, *([f"  and {rest} more, which --json lists"] if rest else [])]


def _method(comparison: Comparison) -> list[str]:
    rows = comparison.differences
    counts, samples = [row.change.count for row in rows], comparison.samples
    span = samples.counted(max(counts)) if len(set(counts)) == 1 else f"{min(counts)} to {samples.counted(max(counts))}"
    kind, compared = samples.kind, comparison.compared
    identical = f" ({len(rows) - compared} identical ones are not counted)" * (compared < len(rows))
    methods = []
    if not all(row.is_rate for row in rows):
        methods.append(f"bootstrap-t over {kind}. p: the larger of the bootstrap's and the exact sign-flip test's")
    if any(row.is_rate for row in rows):
        methods.append(f"{'of rates: ' * bool(methods)}Newcombe's over {kind}. p: McNemar's exact test")
    lines = [
        f"{comparison.matched} pairs of runs, {span}, {compared} comparison{'s' * (compared != 1)}{identical}. "
        f"Intervals: {'; intervals '.join(methods)}; corrected by Holm.",
    ]
    if not compared:
        return lines
    fewest, needed = min(counts), _needed(comparison, compared)
    if needed is None:
        lines.append("So many comparisons leave nothing to be significant first: ask for fewer metrics or conditions.")
    elif fewest < needed:
        lines.append(
            f"With {fewest} {kind if fewest > 1 else kind[:-1]} no p can be below {smallest_p_value(fewest):.3g}, "
            f"however large a difference is: it takes {seeds_needed(1)} {kind} for one comparison"
            + f", {needed} for {compared} of them" * (compared > 1)
            + "."
        )
    return lines


def _interval(row: Difference) -> str:
    if not math.isfinite(row.change.low):
        return "needs 4 seeds"
    return f"{row.change.low:+.3g} to {row.change.high:+.3g}"
