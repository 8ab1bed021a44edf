"""The curves of a benchmark as SVG files, for papers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.bench.grid.axis import Axis
from coopsim.bench.grid.labels import mildest_along, values_of, varying_axes
from coopsim.bench.paper.tables import short_names
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.text.forms import name_of
from coopsim.metrics.built_in import is_yes_no
from coopsim.viz.charts import (
    COLUMN_IN,
    PAGE_IN,
    draw_series,
    fit_beside,
    label_ends,
    legend_below,
    limit_height,
    name_ticks,
    policy_styles,
    to_svg,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS, _HEIGHT_IN, _ROW_IN = 3, 2.7, 2.1


def plots(table: ResultTable, metric: str, *, together: bool = False) -> dict[str, str]:
    """Plot a metric against every axis that varies. Return SVG by file name.

    There is a panel for each scenario, in files such as `sAMOTA_latency.svg`; or, `together`, one panel for the mean
    over all, in files such as `crash_over_latency.svg`. All other axes are where they disturb least. Bars are 95 %
    intervals over seeds, or over drawn places.

    Raises:
        UnknownNameError: there is no such metric.
    """
    table.values(metric)  # which knows the name
    parts: list[str | None] = [None] if together else [*table.scenarios]
    return {
        f"{metric}{'_over' * together}_{axis.title.replace(' ', '_')}.svg": _plot(table, metric, axis, parts)
        for axis in varying_axes(table.conditions)
        if len({axis.value(table.conditions[k]) for k in mildest_along(axis, table.conditions)}) > 1 or not together
    }


def _plot(table: ResultTable, metric: str, axis: Axis, scenarios: Sequence[str | None]) -> str:
    """Draw a panel for each scenario; None stands for all of them together."""
    columns = min(len(scenarios), _COLUMNS)
    rows = math.ceil(len(scenarios) / columns)
    height_in = _HEIGHT_IN if rows == 1 else _ROW_IN * rows + 0.6
    short, styles = short_names(table), policy_styles(table.policies)
    names = {short[policy]: look for policy, look in styles.items()}

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for panel, scenario in zip(panels, scenarios, strict=False):
            _panel(panel, table, metric, axis, scenario)
            panel.set(title=scenario or "", xlabel=axis.label)
        for panel in panels[len(scenarios) :]:
            panel.set_axis_off()
        limit_height(list(panels[: len(scenarios)]), from_zero=is_yes_no(metric))
        for panel in panels[::columns]:
            panel.set_ylabel(name_of(metric))
        if axis.named or not fit_beside(list(names)):
            legend_below(figure, names, lines=not axis.named)
        else:
            last = panels[columns - 1]
            lines = [each for each in last.get_lines() if each.get_zorder() == 3]
            places = [line.get_xydata()[-1].tolist() for line in lines]
            ends = [(name, look, x, y) for (name, look), (x, y) in zip(names.items(), places, strict=True)]
            label_ends(last, ends, height_in / rows - 0.6)

    return to_svg(draw, COLUMN_IN if len(scenarios) == 1 else PAGE_IN, height_in)


def _panel(panel: Any, table: ResultTable, metric: str, axis: Axis, scenario: str | None) -> None:
    chosen = mildest_along(axis, table.conditions)
    here = [k for k in chosen if scenario in (None, table.conditions[k].scenario)]
    names = values_of(axis, [table.conditions[k] for k in here])
    known = [value for value in names if not isinstance(value, str) and math.isfinite(value)]
    # No limit stands to the right of the largest value, on a logarithmic axis.
    endless = not axis.named and len(known) < len(names)
    shown = list(known) + [4 * max(known) if known else 1.0] * endless
    places = np.arange(len(names), dtype=float) if axis.named else np.array(shown)
    for number, look in enumerate(policy_styles(table.policies).values()):
        steps = [[k for k in here if axis.value(table.conditions[k]) == value] for value in names]
        found = [table.mean(metric, number, conditions) for conditions in steps]
        ends = np.array([(each.low, each.high) for each in found]).reshape(-1, 2)
        shift = 0.06 * (number - (len(table.policies) - 1) / 2) if axis.named else 0.0
        draw_series(panel, places + shift, np.array([each.mean for each in found]), ends, look, lines=not axis.named)
    if axis.named:
        name_ticks(panel, list(names.values()))
    elif endless:
        panel.set_xscale("log")
        panel.set_xticks(places, list(names.values()))
        panel.minorticks_off()
