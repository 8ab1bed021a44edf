"""Answers of a benchmark with attacks, as Markdown: what lies cost, what defences win back, and what they find.

Differences are paired by seed: the same world with and without a lie, with and without a defence. Where several
disturbances vary, their means stand for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coopsim.bench.grid.axis import NOBODY_LIES
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import bootstrap_difference
from coopsim.bench.text.forms import TextTable, difference_text, form_of, mean_cells, sections_text
from coopsim.catalog import PolicySpec
from coopsim.geometry.se3 import Floats
from coopsim.metrics.deception import DECEPTION
from coopsim.metrics.finding import FINDING
from coopsim.metrics.metric import PRIMARY_METRIC


def to_lies_markdown(table: ResultTable, metric: str = PRIMARY_METRIC) -> str:
    """Format all answers about a metric; parts for which the results have no data are left out."""
    parts = [(heading, found.markdown(), note) for heading, found, note in lies_parts(table, metric)]
    return sections_text("Lies", parts) + f"\nIntervals are of 95 %, over {table.samples.text}.\n"


def lies_parts(table: ResultTable, metric: str = PRIMARY_METRIC) -> list[tuple[str, TextTable, str]]:
    """Return headings, tables and notes on a metric under lies; a table without data has no rows."""
    return [
        (f"{metric} under attack", _scores(table, metric), "Means."),
        ("What lies cost", _costs(table, metric), f"Change of {metric} against the same policy when nobody lies."),
        ("What defences win back", _won_back(table, metric), _WON_BACK_NOTE.format(metric)),
        ("Liars found", _means(table, tuple(FINDING), lying=True), "Means over the attacks."),
        ("Honest senders doubted", _means(table, ("attacker_FPR",), lying=False), f"Means when {NOBODY_LIES}."),
        ("Lies believed", _lies(table), "Means of each policy and attack."),
    ]


_WON_BACK_NOTE = """Change of {} against the same policy without a defence, under the same attack. The first row is what
a defence costs when nobody lies."""


def _attacks(table: ResultTable) -> list[tuple[str, list[int]]]:
    """Return the attacks in words, none first, with the numbers of their conditions."""
    texts = sorted({each.attacks for each in table.conditions})
    return [
        (text or NOBODY_LIES, [k for k, each in enumerate(table.conditions) if each.attacks == text]) for text in texts
    ]


def _scores(table: ResultTable, metric: str) -> TextTable:
    rows = [
        [attack, *((mean_cells(table, [metric], k, conditions) or ["-"])[0] for k in range(len(table.policies)))]
        for attack, conditions in _attacks(table)
    ]
    return TextTable(["attack", *table.names.values()], rows)


def _costs(table: ResultTable, metric: str) -> TextTable:
    honest = {each.changed(attacks=""): k for k, each in enumerate(table.conditions) if not each.attacks}
    values = table.values(metric)
    rows = []
    for attack, conditions in _attacks(table):
        pairs = [(k, honest.get(table.conditions[k].changed(attacks=""))) for k in conditions]
        if attack == NOBODY_LIES or any(before is None for _, before in pairs):
            continue
        changed = [values[:, k] - values[:, before] for k, before in pairs if before is not None]
        rows.append([attack, *(_change(table, metric, each) for each in np.mean(changed, axis=0))])
    return TextTable(["attack", *table.names.values()], rows)


def _won_back(table: ResultTable, metric: str) -> TextTable:
    values, twins = table.values(metric), _undefended(table)
    rows = []
    for attack, conditions in _attacks(table):
        changes = [values[k, conditions].mean(axis=0) - values[twin, conditions].mean(axis=0) for k, twin in twins]
        rows.append([attack, *(_change(table, metric, each) for each in changes)])
    return TextTable(["attack", *(table.names[table.policies[k]] for k, _ in twins)], rows if twins else [])


def _undefended(table: ResultTable) -> list[tuple[int, int]]:
    """Return the numbers of policies with a defence, each with that of the same policy without one."""
    found = []
    for k, text in enumerate(table.policies):
        spec = PolicySpec.parse(text)
        bare = replace(spec, parameters={name: value for name, value in spec.parameters.items() if name != "defense"})
        if bare.text != spec.text and bare.text in table.policies:
            found.append((k, table.policies.index(bare.text)))
    return found


def _means(table: ResultTable, metrics: Sequence[str], *, lying: bool) -> TextTable:
    known = [name for name in metrics if name in table.metrics]
    conditions = [k for k, each in enumerate(table.conditions) if bool(each.attacks) == lying]
    found = [[policy, *mean_cells(table, known, k, conditions)] for k, policy in enumerate(table.names.values())]
    return TextTable(["policy", *known], [row for row in found if len(row) > 1])


def _lies(table: ResultTable) -> TextTable:
    known = [name for name in DECEPTION if name in table.metrics]
    found = [
        [attack, policy, *mean_cells(table, known, k, conditions)]
        for attack, conditions in _attacks(table)
        for k, policy in enumerate(table.names.values())
    ]
    return TextTable(["attack", "policy", *known], [row for row in found if len(row) > 2], texts=2)


def _change(table: ResultTable, metric: str, differences: Floats) -> str:
    """Format the mean of paired differences (S,) with its interval; "-" without a pair."""
    known = table.samples.average(differences)
    known = known[~np.isnan(known)]
    if not len(known):
        return "-"
    interval, _ = bootstrap_difference(known)
    return difference_text(interval, form_of(metric))
