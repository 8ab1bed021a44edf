"""Figures of a benchmark of situations: the crash rate over every axis and over bytes, with Wilson's intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.bench.grid.axis import Axis
from coopsim.bench.grid.labels import varying_axes
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.results.statistics import Interval
from coopsim.bench.safety.paired import along, calm
from coopsim.bench.safety.safety_text import crash_rate
from coopsim.bench.text.bytes_axis import place_bytes
from coopsim.metrics.built_in import BYTES
from coopsim.support.svg import line_style, name_ticks, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH_IN, _HEIGHT_IN, _ROW_IN, _COLUMNS = 5.6, 3.2, 0.2, 2
"""Size of a figure, height of a row of its legend, and columns of that."""


def crash_plots(table: ResultTable) -> dict[str, str]:
    """Plot the crash rate over all situations against each axis, and against bytes. Return SVG by file name."""
    made = {f"crash_over_{axis.title.replace(' ', '_')}.svg": _over_axis(table, axis) for axis in _axes(table)}
    return {**made, "crash_over_bytes.svg": _over_bytes(table)} if BYTES in table.metrics else made


def _axes(table: ResultTable) -> tuple[Axis, ...]:
    return tuple(axis for axis in varying_axes(table.conditions) if len(along(table, axis)) > 1)


def _over_axis(table: ResultTable, axis: Axis) -> str:
    steps = along(table, axis)

    def draw(figure: Figure) -> None:
        panel = _panel(figure, axis.title)
        name_ticks(panel, [text for text, _ in steps])
        for k, name in enumerate(table.names.values()):
            rates = [crash_rate(table, k, conditions) for _, conditions in steps]
            shift = 0.03 * (k - (len(table.policies) - 1) / 2)  # side by side: whiskers must not hide each other
            style, color = line_style(k)
            _errorbar(panel, np.arange(len(steps)) + shift, rates, "o" if axis.named else f"o{style}", color, name)
        _finish(figure, panel)

    return to_svg(draw, *_size_in(table))


def _over_bytes(table: ResultTable) -> str:
    conditions = calm(table)
    sent = known_mean(table.values(BYTES)[:, conditions].reshape(len(table.policies), -1), axis=1)

    def draw(figure: Figure) -> None:
        panel = _panel(figure, "bytes per second that an agent broadcasts")
        places = place_bytes(panel, sent[np.isfinite(sent)].tolist())
        known = [k for k, rate in enumerate(sent) if math.isfinite(rate)]
        for place, k in zip(places, known, strict=True):
            name = table.names[table.policies[k]]
            _errorbar(panel, np.array([place]), [crash_rate(table, k, conditions)], "o", line_style(k)[1], name)
        _finish(figure, panel)

    return to_svg(draw, *_size_in(table))


def _size_in(table: ResultTable) -> tuple[float, float]:
    return _WIDTH_IN, _HEIGHT_IN + _ROW_IN * math.ceil(len(table.policies) / _COLUMNS)


def _finish(figure: Figure, panel: Any) -> None:
    """End the vertical axis above the highest whisker, with room for a marker at 0, and put the legend below."""
    top = 10 * math.ceil(min(max(1.05 * panel.dataLim.y1, 1.0), 100.0) / 10)
    panel.set_ylim(-0.03 * top, top)
    figure.legend(fontsize=9, frameon=False, loc="outside lower center", ncols=_COLUMNS)


def _panel(figure: Figure, label: str) -> Any:
    panel = figure.subplots()
    panel.set(xlabel=label, ylabel="episodes with a crash (%)")
    panel.grid(alpha=0.25)
    return panel


def _errorbar(panel: Any, places: Any, rates: list[Interval], style: str, color: str, name: str) -> None:
    means = np.array([each.mean for each in rates])
    ends = np.array([[each.mean - each.low, each.high - each.mean] for each in rates]).T
    label = f" {name}" if name.startswith("_") else name  # matplotlib leaves out labels that begin with an underscore
    whiskers = np.nan_to_num(np.maximum(ends, 0))
    panel.errorbar(places, means, whiskers, fmt=style, color=color, ms=4, capsize=2, label=label)
