"""The section of a report on crashes: tables and figures."""

from __future__ import annotations

import html

import numpy as np

from coopsim.bench.films.crash_pairs import CRASH
from coopsim.bench.report.bench_tables import text_table
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import Interval
from coopsim.bench.safety.lie_costs import CRASH_HEADS, cost_heads, cost_rows, crash_rows
from coopsim.bench.safety.safety_text import (
    ALL_SITUATIONS,
    CHANGE_HEADS,
    change_rows,
    crash_rate,
    gone_tables,
    price_heads,
    price_rows,
    situations,
)

_NOTE = """<p class="note">Episodes in which the driven car crashed, where nothing disturbs, or as little as was run,
with Wilson's 95 % intervals and their number n.</p>"""

_CHANGES_NOTE = """<p class="note">Against the policy that sends nothing, with the same seeds. <i>Avoided</i>: without
messages it crashes, with them it does not; <i>caused</i>: the other way round. p is McNemar's, corrected for all rows
by Holm's method.</p>"""

_PRICES_NOTE = """<p class="note">Mean per episode, with messages minus without, and 95 % intervals.</p>"""

_GONE_NOTE = """<p class="note">Difference of crash rates, with messages minus without, in percentage points, while
nothing else disturbs. The last column has the first value from which on fewer crashes are not shown.</p>"""

_LIES_NOTE = """<p class="note">Against the same policy with the same seeds while nobody lies. <i>Avoided</i>: only the
honest run ends in a crash; <i>caused</i>: only that with the lie. Below, differences per episode: brakes for nothing,
hard brakes, share of the way driven, and time lost.</p>"""


def crashes_section(table: ResultTable) -> str:
    """Return the section as HTML; empty where no car was driven."""
    if CRASH not in table.metrics:
        return ""
    changes, lies, costs = change_rows(table), crash_rows(table), cost_rows(table)
    prices, gone = price_rows(table), gone_tables(table)
    parts = [
        "<section><h2>Crashes</h2>",
        matrix_html(table) + _NOTE,
        f"<h3>What messages change</h3>{_changes(changes)}{_CHANGES_NOTE}" if changes else "",
        f"<h3>What messages cost</h3>{text_table(price_heads(table), prices)}{_PRICES_NOTE}" if prices else "",
        *(f"<h3>Under {html.escape(axis.title)}</h3>{text_table(heads, rows)}" for axis, heads, rows in gone),
        _GONE_NOTE if gone else "",
        f"<h3>What lies cost</h3>{text_table(CRASH_HEADS, lies, texts=2)}{_LIES_NOTE}" if lies else "",
        text_table(cost_heads(table), costs, texts=2) if costs else "",
        "</section>",
    ]
    return "".join(parts)


def _changes(rows: list[list[str]]) -> str:
    """Return the changes over all situations as a table, and those in each, folded."""
    whole = [row for row in rows if row[1] == ALL_SITUATIONS]
    if not whole:
        return text_table(CHANGE_HEADS, rows, texts=2)
    each = text_table(CHANGE_HEADS, [row for row in rows if row[1] != ALL_SITUATIONS], texts=2)
    return f"{text_table(CHANGE_HEADS, whole, texts=2)}<details><summary>In each situation</summary>{each}</details>"


def matrix_html(table: ResultTable) -> str:
    """Return the crash rates of situations by policies as an HTML table, darker with more crashes."""
    heads = "".join(f"<th>{html.escape(name)}</th>" for name in table.names.values())
    rows = []
    for scenario, conditions in situations(table):
        cells = []
        for k in range(len(table.policies)):
            rate = crash_rate(table, k, conditions)
            share = 0 if np.isnan(rate.mean) else rate.mean
            shade = f"background: rgb(212 60 40 / {0.55 * share / 100:.3f})"
            cells.append(f'<td style="{shade}">{_rate_html(rate)}</td>')
        rows.append(f'<tr><td class="about">{html.escape(scenario)}</td>{"".join(cells)}</tr>')
    return (
        f'<div class="scroll"><table><thead><tr><th class="about">situation</th>{heads}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _rate_html(rate: Interval) -> str:
    if not rate.count:
        return "-"
    return f'{rate.mean:.0f} % <span class="dim">{rate.low:.0f} to {rate.high:.0f}, n {rate.count}</span>'
