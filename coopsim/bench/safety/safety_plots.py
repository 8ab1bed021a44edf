"""Figures of a benchmark of situations: the crash rate over every axis and over bytes, with Wilson's intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.bench.grid.cell import Axis, varying_axes
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import known_mean
from coopsim.bench.results.statistics import Interval
from coopsim.bench.safety.paired import along, calm
from coopsim.bench.safety.safety_text import crash_rate
from coopsim.metrics.built_in import BYTES
from coopsim.support.svg import line_style, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE_IN = (6.4, 3.6)


def crash_plots(table: ResultTable) -> dict[str, str]:
    """Plot the crash rate over all situations against each axis, and against bytes. Return SVG by file name."""
    made = {f"crash_over_{axis.title.replace(' ', '_')}.svg": _over_axis(table, axis) for axis in _axes(table)}
    return {**made, "crash_over_bytes.svg": _over_bytes(table)} if BYTES in table.metrics else made


def _axes(table: ResultTable) -> tuple[Axis, ...]:
    return tuple(axis for axis in varying_axes(table.conditions) if len(along(table, axis)) > 1)


def _over_axis(table: ResultTable, axis: Axis) -> str:
    steps = along(table, axis)

    def draw(figure: Figure) -> None:
        panel = _panel(figure, axis.label)
        panel.set_xticks(range(len(steps)), [text for text, _ in steps])
        for k, name in enumerate(table.names.values()):
            rates = [crash_rate(table, k, conditions) for _, conditions in steps]
            shift = 0.03 * (k - (len(table.policies) - 1) / 2)  # side by side: whiskers must not hide each other
            style, color = line_style(k)
            _errorbar(panel, np.arange(len(steps)) + shift, rates, f"o{style}", color, name)
        panel.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))

    return to_svg(draw, *_SIZE_IN)


def _over_bytes(table: ResultTable) -> str:
    conditions = calm(table)
    sent = known_mean(table.values(BYTES)[:, conditions].reshape(len(table.policies), -1), axis=1)

    def draw(figure: Figure) -> None:
        panel = _panel(figure, "bytes per second that an agent broadcasts")
        panel.set_xscale("symlog", linthresh=max(float(np.min(sent, where=sent > 0, initial=math.inf)), 1.0) / 3)
        for k, name in enumerate(table.names.values()):
            _errorbar(panel, sent[[k]], [crash_rate(table, k, conditions)], "o", line_style(k)[1], name)
        panel.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))

    return to_svg(draw, *_SIZE_IN)


def _panel(figure: Figure, label: str) -> Any:
    panel = figure.subplots()
    panel.set(xlabel=label, ylabel="episodes with a crash (%)", ylim=(0, 100))
    panel.grid(alpha=0.25)
    return panel


def _errorbar(panel: Any, places: Any, rates: list[Interval], style: str, color: str, name: str) -> None:
    means = np.array([each.mean for each in rates])
    ends = np.array([[each.mean - each.low, each.high - each.mean] for each in rates]).T
    label = f" {name}" if name.startswith("_") else name  # matplotlib leaves out labels that begin with an underscore
    whiskers = np.nan_to_num(np.maximum(ends, 0))
    panel.errorbar(places, means, whiskers, fmt=style, color=color, ms=4, capsize=2, label=label)
