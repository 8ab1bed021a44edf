"""The section of a report on crashes: the answer in sentences, tables of it, and figures."""

from __future__ import annotations

import html
from collections.abc import Iterator

import numpy as np

from coopsim.bench.films.crash_pairs import CRASH, policy_alone
from coopsim.bench.report.bench_tables import text_table
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import Interval
from coopsim.bench.safety.lie_costs import CRASH_HEADS, cost_heads, cost_rows, crash_rows
from coopsim.bench.safety.paired import calm, change
from coopsim.bench.safety.safety_plots import crash_plots
from coopsim.bench.safety.safety_text import CHANGE_HEADS, change_rows, crash_rate, situations
from coopsim.bench.text.forms import difference_text

_NOTE = """<p class="note">Episodes in which the driven car crashed, where nothing disturbs, or as little as was run,
with Wilson's 95 % intervals and their number n.</p>"""

_CHANGES_NOTE = """<p class="note">Against the policy that sends nothing, with the same seeds. <i>Avoided</i>: alone it
crashes, with messages it does not; <i>caused</i>: the other way round. p is McNemar's, corrected for all rows by Holm's
method. What messages cost is in <code>safety.md</code>, beside this page.</p>"""

_LIES_NOTE = """<p class="note">Against the same policy with the same seeds while nobody lies. <i>Avoided</i>: only the
honest run ends in a crash; <i>caused</i>: only that with the lie. Below, differences per episode: brakes for nothing,
hard brakes, share of the way driven, and time lost.</p>"""


def crashes_section(table: ResultTable) -> str:
    """Return the section as HTML; empty where no car was driven."""
    if CRASH not in table.metrics:
        return ""
    answers = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in answers_of(table))
    changes, lies, costs = change_rows(table), crash_rows(table), cost_rows(table)
    parts = [
        "<section><h2>Crashes</h2>",
        f"<ul>{answers}</ul>" if answers else "",
        matrix_html(table) + _NOTE,
        f"<h3>What messages change</h3>{text_table(CHANGE_HEADS, changes, texts=2)}{_CHANGES_NOTE}" if changes else "",
        f"<h3>What lies cost</h3>{text_table(CRASH_HEADS, lies, texts=2)}{_LIES_NOTE}" if lies else "",
        text_table(cost_heads(table), costs, texts=2) if costs else "",
        f'<div class="figures">{"".join(crash_plots(table).values())}</div></section>',
    ]
    return "".join(parts)


def answers_of(table: ResultTable) -> Iterator[str]:
    """Yield a sentence for each policy: how often its car crashes, and what messages change."""
    alone, conditions = policy_alone(table), calm(table)
    if alone is not None:
        yield f"Alone ({table.policies[alone]}), {_share(crash_rate(table, alone, conditions))}."
    for k, policy in enumerate(table.policies):
        found = change(table, k, conditions) if k != alone else None
        if k == alone or policy in table.bounds:
            continue
        text = f"With {policy}, {_share(crash_rate(table, k, conditions))}"
        if found is not None:
            text += f": {found.less} avoided and {found.more} caused in {found.pairs} pairs of the same seed, "
            text += f"a difference of {difference_text(found.change, '.0f')} points"
        yield f"{text}."


def _share(rate: Interval) -> str:
    if not rate.count:
        return "no run was finished"
    return f"{rate.mean:.0f} % of the episodes end in a crash ({rate.low:.0f} to {rate.high:.0f})"


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
