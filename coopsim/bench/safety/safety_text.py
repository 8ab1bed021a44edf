"""Answers of a benchmark of situations, as Markdown: crash rates, crashes that messages avoid, and what they cost.

Rates have Wilson's intervals, differences are paired by situation and seed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.bench.films.crash_pairs import CRASH, policy_alone
from coopsim.bench.grid.axis import Axis
from coopsim.bench.grid.labels import varying_axes
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.results.statistics import Interval, holm
from coopsim.bench.safety.lie_costs import COSTS, CRASH_HEADS, cost_heads, cost_rows, crash_rows
from coopsim.bench.safety.paired import Change, along, calm, change, changes_along, gone_at, kinds_of, rank_correlation
from coopsim.bench.text.forms import difference_text, form_of, format_value, markdown_table, mean_cells, sections_text
from coopsim.metrics.built_in import BYTES
from coopsim.metrics.driving import DRIVING

_PREDICTORS = ("AMOTA", "sAMOTA", "MOTA", "HOTA", "mAP3D@0.5", "APBEV@0.5", "recall", "lead_time")

ALL_SITUATIONS = "all situations"
"""Name of the row over them."""


def to_safety_markdown(table: ResultTable) -> str:
    """Format all answers; parts for which the results have no data are left out."""
    parts = [
        (
            "Crash rates",
            _matrix_text(table),
            "Episodes with a crash of the driven car, and 95 % intervals.",
        ),
        ("What messages change", markdown_table(CHANGE_HEADS, change_rows(table), texts=2), CHANGES_NOTE),
        (
            "What they cost",
            markdown_table(price_heads(table), price_rows(table)),
            "Mean per episode, with messages minus without, with 95 % intervals.",
        ),
        ("Scores", markdown_table(SCORE_HEADS, score_rows(table), texts=3), _SCORES_NOTE),
        ("What lies cost", _lies(table), _LIES_NOTE),
        ("Driving", _driving(table), "Means over all situations where nothing disturbs, or as little as was run."),
        (
            "Crashes over bytes",
            _bytes(table),
            "Where nothing disturbs, or as little as was run; policies by the bytes that an agent sends.",
        ),
        ("Where the gain ends", _gone(table), _GONE_NOTE),
        ("What predicts crashes", _predictors(table), _PREDICTORS_NOTE),
    ]
    return sections_text("Safety", parts)


CHANGE_HEADS = (
    *("policy", "situation", "pairs", "without messages", "with messages", "avoided", "caused", "difference", "p"),
)

CHANGES_NOTE = """Against the policy that sends nothing, with the same seeds, where nothing disturbs, or as little as
was run. *Avoided*: without messages it crashes, with them it does not; *caused*: the other way round. p is McNemar's,
corrected for all rows by Holm's method."""

SCORE_HEADS = ("policy", "drives", "metric", "pairs", "without messages", "with messages", "difference", "p")

_SCORES = ("driving_score", "success", "epdms", "crash", "lead_time")

_SCORES_NOTE = """Means over the paired drives of each kind, and 95 % intervals of the difference. p is McNemar's of
yes or no, else that of a paired bootstrap, corrected for all rows by Holm's method."""

_LIES_NOTE = """Each attack against the same policy with the same seeds while nobody lies, and nothing else disturbs.
*Avoided*: only the honest run ends in a crash; *caused*: only that with the lie. The second table has mean differences
per episode, lie minus honest, with 95 % intervals: brakes for nothing, hard brakes, share of the way driven, and time
lost."""

_GONE_NOTE = """Difference of crash rates, with messages minus without, in percentage points, while nothing else
disturbs. *Gain ends at*: the first value from which on the 95 % interval has 0, so that fewer crashes are not shown.
*No gain shown*: it has 0 from the first value on."""

_PREDICTORS_NOTE = """Spearman's rank correlation over policies, upper bounds left out, with a 95 % interval by a
bootstrap over situations and seeds. -1: the better policy by the metric always crashes less; 0: it says nothing."""


def crash_rate(table: ResultTable, policy: int, conditions: Sequence[int]) -> Interval:
    """Return the crash rate of a policy in some conditions, per cent, with Wilson's interval."""
    return table.mean(CRASH, policy, conditions)


def situations(table: ResultTable) -> list[tuple[str, list[int]]]:
    """Return the situations with the condition that disturbs least, then the kinds of drives, and all together."""
    rows = [(scenario, calm(table, scenario)) for scenario in table.scenarios] + kinds_of(table)
    return [*rows, (ALL_SITUATIONS, calm(table))] if len(rows) > 1 else rows


def _matrix_text(table: ResultTable) -> str:
    rows = [
        [scenario, *(_rate(crash_rate(table, k, conditions)) for k in range(len(table.policies)))]
        for scenario, conditions in situations(table)
    ]
    return markdown_table(["situation", *table.names.values()], rows)


def _competitors(table: ResultTable) -> list[int]:
    base = policy_alone(table)
    return [k for k in range(len(table.policies)) if k != base] if base is not None else []


def change_rows(table: ResultTable) -> list[list[str]]:
    """Return rows of text below `CHANGE_HEADS`: crashes that messages avoid and cause, by policy and situation."""
    tried = [
        (scenario, change(table, k, conditions))
        for k in _competitors(table)
        for scenario, conditions in situations(table)
    ]
    known = [(scenario, found) for scenario, found in tried if found is not None]
    corrected = holm(np.array([found.p_value for _, found in known]))
    return [
        [table.names[found.policy], scenario, *_change_cells(found), f"{p_value:.2g}"]
        for (scenario, found), p_value in zip(known, corrected.tolist(), strict=True)
    ]


def score_rows(table: ResultTable) -> list[list[str]]:
    """Return rows of text below `SCORE_HEADS`: what messages change in scores, by policy and kind of drives."""
    tried = [
        (kind, metric, change(table, k, conditions, metric))
        for k in _competitors(table)
        for kind, conditions in kinds_of(table)
        for metric in _SCORES
    ]
    known = [(kind, metric, found) for kind, metric, found in tried if found is not None]
    corrected = holm(np.array([found.p_value for *_, found in known]))
    rows = []
    for (kind, metric, found), p_value in zip(known, corrected.tolist(), strict=True):
        form = form_of(metric)
        cells = [
            format_value(found.alone, form),
            format_value(found.sharing, form),
            difference_text(found.change, form),
        ]
        rows.append([table.names[found.policy], kind, metric, str(found.pairs), *cells, f"{p_value:.2g}"])
    return rows


def _change_cells(found: Change) -> list[str]:
    rates = [f"{rate:.0f} %" for rate in (found.alone, found.sharing)]
    return [str(found.pairs), *rates, str(found.less), str(found.more), difference_text(found.change, ".1f")]


def price_heads(table: ResultTable) -> list[str]:
    """Return the headings of `price_rows`."""
    return ["policy", *(COSTS[name] for name in _prices(table))]


def _prices(table: ResultTable) -> list[str]:
    return [name for name in COSTS if name in table.metrics]


def price_rows(table: ResultTable) -> list[list[str]]:
    """Return rows of text: what messages change besides crashes, by policy and metric."""
    metrics = _prices(table)
    rows = []
    for k in _competitors(table) if metrics else ():
        found = [change(table, k, calm(table), name) for name in metrics]
        cells = [
            "-" if each is None else difference_text(each.change, form_of(name))
            for each, name in zip(found, metrics, strict=True)
        ]
        rows.append([table.names[table.policies[k]], *cells])
    return rows


def _lies(table: ResultTable) -> str:
    parts = [
        markdown_table(CRASH_HEADS, crash_rows(table), texts=2),
        markdown_table(cost_heads(table), cost_rows(table), texts=2),
    ]
    return "\n\n".join(part for part in parts if part)


def _driving(table: ResultTable) -> str:
    metrics = [name for name in DRIVING if name in table.metrics]
    dashes, chosen = ["-"] * len(metrics), calm(table)
    names = enumerate(table.names.values())
    rows = [[policy, *(mean_cells(table, metrics, k, chosen) or dashes)] for k, policy in names]
    return markdown_table(["policy", *metrics], rows)


def _bytes(table: ResultTable) -> str:
    if BYTES not in table.metrics:
        return ""
    rates = known_mean(table.values(BYTES)[:, calm(table)].reshape(len(table.policies), -1), axis=1)
    rows = [
        [table.names[table.policies[k]], format_value(float(rates[k]), ".0f"), _rate(crash_rate(table, k, calm(table)))]
        for k in np.argsort(rates, kind="stable").tolist()
    ]
    return markdown_table(["policy", "bytes/s", "crash rate"], rows)


def _gone(table: ResultTable) -> str:
    return "\n\n".join(f"### {axis.title}\n\n{markdown_table(heads, rows)}" for axis, heads, rows in gone_tables(table))


def gone_tables(table: ResultTable) -> list[tuple[Axis, list[str], list[list[str]]]]:
    """Return for each axis the headings and rows of text of differences along it, and where the gain ends."""
    tables = []
    for axis in varying_axes(table.conditions):
        rows = []
        for k in _competitors(table):
            found = changes_along(table, axis, k) if table.policies[k] not in table.bounds else []
            if not found:
                continue
            cells = [difference_text(each.change, ".1f") for _, each in found]
            rows.append([table.policies[k], *cells, gone_at(axis, found)])
        if rows:
            heads = [
                "policy",
                *(text for text, _ in along(table, axis)),
                "gain ends under" if axis.named else "gain ends at",
            ]
            tables.append((axis, heads, rows))
    return tables


def _predictors(table: ResultTable) -> str:
    found = [rank_correlation(table, name, calm(table)) for name in _PREDICTORS]
    rows = [
        [each.metric, f"{each.value:.2f}", f"{each.low:.2f} to {each.high:.2f}", str(each.policies)]
        for each in found
        if each is not None
    ]
    return markdown_table(["metric", "rank correlation", "95 % interval", "policies"], rows) if rows else ""


def _rate(rate: Interval) -> str:
    return f"{rate.mean:.0f} % ({rate.low:.0f} to {rate.high:.0f})" if rate.count else "-"
