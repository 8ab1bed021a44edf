"""The curves of a benchmark as SVG files, for papers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.bench.grid.axis import Axis
from coopsim.bench.grid.labels import mildest_along, values_of, varying_axes
from coopsim.bench.results.result_table import ResultTable
from coopsim.support.svg import line_style, name_ticks, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plots(table: ResultTable, metric: str) -> dict[str, str]:
    """Plot a metric against every axis that varies, with a panel for each scenario. Return SVG by file name.

    File names are as `sAMOTA_latency.svg`. All other axes are at their mildest value. Whiskers are 95 % intervals over
    seeds, or over drawn places.

    Raises:
        UnknownNameError: there is no such metric.
    """
    table.values(metric)  # which knows the name
    return {
        f"{metric}_{axis.title.replace(' ', '_')}.svg": _plot(table, metric, axis)
        for axis in varying_axes(table.conditions)
    }


def _plot(table: ResultTable, metric: str, axis: Axis) -> str:
    count = len(table.scenarios)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, count, sharey=True, squeeze=False)[0]
        for panel, scenario in zip(panels, table.scenarios, strict=True):
            _panel(panel, table, metric, axis, scenario)
            panel.set(title=scenario, xlabel=axis.label)
        panels[0].set_ylabel(metric)
        panels[0].legend(fontsize=9, frameon=False)

    return to_svg(draw, 1.2 + 3.4 * count, 3.2)


def _panel(panel: Any, table: ResultTable, metric: str, axis: Axis, scenario: str) -> None:
    values = table.values(metric)
    steps = sorted(
        (axis.value(table.conditions[k]), k)
        for k in mildest_along(axis, table.conditions)
        if table.conditions[k].scenario == scenario
    )
    names = values_of(axis, [table.conditions[k] for _, k in steps])
    chosen = [(float(list(names).index(value) if axis.named else value), k) for value, k in steps]
    if axis.named:
        name_ticks(panel, list(names.values()))
    known = [value for value, _ in chosen if math.isfinite(value)]
    # No limit stands to the right of the largest value, on a logarithmic axis.
    endless = len(known) < len(chosen)
    places = [value if math.isfinite(value) else (4 * max(known) if known else 1.0) for value, _ in chosen]
    for number, policy in enumerate(table.names.values()):
        intervals = [table.interval(metric, values[number, k]) for _, k in chosen]
        means = np.array([each.mean for each in intervals])
        whiskers = np.array([each.whiskers for each in intervals]).T
        style, color = line_style(number)
        # Matplotlib leaves out labels that begin with an underscore.
        name = f" {policy}" if policy.startswith("_") else policy
        look = {"fmt": "o" if axis.named else f"o{style}", "color": color, "ms": 3, "capsize": 2, "lw": 1.2}
        panel.errorbar(places, means, whiskers, label=name, **look)
    if endless:
        panel.set_xscale("log")
        panel.set_xticks(places, [f"{value:g}" if math.isfinite(value) else axis.endless for value, _ in chosen])
        panel.minorticks_off()
    panel.grid(alpha=0.25)
