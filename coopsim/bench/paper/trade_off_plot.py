"""A metric over bytes per second as SVG: what each method reaches, and what it sends for it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.bench.grid.labels import mildest
from coopsim.bench.paper.tables import short_names
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.results.statistics import Interval
from coopsim.bench.text.forms import name_of
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES, is_yes_no, less_is_better
from coopsim.viz.charts import GREY, PAGE_IN, Look, limit_height, place_bytes, policy_styles, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SIZE_IN = (PAGE_IN, 4.6)
_LABEL_PT, _MARKER_PT = 7.5, 6.0
_LINE_HEIGHT = 1.25
_FAR, _ENOUGH = 6.0, 5
"""So many interquartile ranges beside the middle half of the values one is far; fewer values have none that is."""

_NAMES_DECADES = 0.8
"""Room for names to the right of the last tick."""

_NAMED_SCENARIOS = 3
"""Most scenarios whose names stand above the figure."""

_LEAST_SAMPLES = 3
"""The interval of fewer is wider than the figure."""

_SENT: Mapping[str, tuple[str, str]] = {
    "none": ("nothing", "X"),
    "detections": ("boxes", "o"),
    "tracks": ("tracks", "^"),
    "queries": ("queries", "P"),
    "features": ("features", "s"),
    "points": ("points", "D"),
}
"""Words and markers by what is sent; colours are those of the policies."""

_OTHER = ("", "o")


@dataclass(frozen=True, slots=True)
class TradeOffPoint:
    """A policy in the figure.

    Attributes:
        name: its name there.
        look: its look, of which the colour counts.
        sends: content that it broadcasts (`Needs.uplink`), which the marker says; "" if that is not known.
        bytes_per_s: bytes that an agent broadcasts in a second.
        value: its metric, drawn with its interval from three samples on.
        edges: values below and above which the marker stands at the edge.
    """

    name: str
    look: Look
    sends: str
    bytes_per_s: float
    value: Interval
    edges: tuple[float, float] = (-math.inf, math.inf)

    @property
    def shown(self) -> float:
        """The height of the marker: the mean, or the edge before it."""
        return min(max(self.value.mean, self.edges[0]), self.edges[1])

    @property
    def far(self) -> bool:
        """True if the mean is beyond an edge."""
        return self.shown != self.value.mean

    @property
    def label(self) -> str:
        """The name, with the number if the marker does not tell it."""
        return f"{self.name}: {self.value.mean:.0f}" if self.far else self.name

    @property
    def whiskers(self) -> tuple[float, float]:
        """Lengths of the whisker below and above the mean; 0: there is none."""
        return (0.0, 0.0) if self.far or self.value.count < _LEAST_SAMPLES else self.value.whiskers


def trade_off(table: ResultTable, metric: str, sends: Mapping[str, str]) -> str:
    """Plot a metric against the bytes per second that an agent broadcasts as SVG, with a marker for each policy.

    Both are means where nothing disturbs, or as little as was run, or over all conditions if the grid lacks that
    corner; bars are 95 % intervals over seeds, or over drawn places, where there are three. A policy that sends nothing
    stands on the left, apart from the logarithmic scale; one far above or below the others stands at the edge, with its
    number. Dashes are the Pareto front: the policies that no other beats in both. `sends` is the content that is
    broadcast, by policy (`Needs.uplink`).
    """
    many = len(table.scenarios) > _NAMED_SCENARIOS
    where = f"{len(table.scenarios)} environments" if many else ", ".join(table.scenarios)
    return plot_trade_off(_points(table, metric, sends), metric, f"{where}: mean over {table.samples.text}")


def plot_trade_off(found: Sequence[TradeOffPoint], metric: str, title: str) -> str:
    """Plot points as `trade_off` does, below a title; those without bytes or a value are left out."""
    known = [each for each in found if not (math.isnan(each.bytes_per_s) or math.isnan(each.value.mean))]
    edges = _edges(known)
    points = sorted((replace(each, edges=edges) for each in known), key=lambda each: (each.bytes_per_s, each.name))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xlabel="bytes a second that an agent broadcasts", ylabel=name_of(metric))
        panel.set_title(title)
        if points:
            _draw_points(panel, points, less_is_better(metric))
            if is_yes_no(metric):
                limit_height([panel], from_zero=True)
            _label(figure, panel, points)

    return to_svg(draw, *_SIZE_IN)


def _points(table: ResultTable, metric: str, sends: Mapping[str, str]) -> list[TradeOffPoint]:
    """Return all policies."""
    calm = [table.conditions.index(each) for each in mildest(table.conditions)] or list(range(len(table.conditions)))
    rates = known_mean(table.values(BYTES)[:, calm], axis=1)
    names, styles = short_names(table), policy_styles(table.policies)
    return [
        TradeOffPoint(names[policy], styles[policy], sends.get(policy, ""), float(rate), table.mean(metric, k, calm))
        for k, (policy, rate) in enumerate(zip(table.policies, known_mean(rates, axis=1), strict=True))
    ]


def _edges(points: Sequence[TradeOffPoint]) -> tuple[float, float]:
    """Return below and above which value one is far from the others, and beyond their whiskers, which are drawn."""
    if len(points) < _ENOUGH:
        return -math.inf, math.inf
    first, third = (float(each) for each in np.percentile([each.value.mean for each in points], [25, 75]))
    reach = _FAR * (third - first) or math.inf
    near = [each for each in points if first - reach <= each.value.mean <= third + reach]
    low = min(each.value.mean - each.whiskers[0] for each in near)
    high = max(each.value.mean + each.whiskers[1] for each in near)
    return min(first - reach, low), max(third + reach, high)


def pareto_front(rates: Sequence[float], values: Sequence[float], less: bool) -> list[int]:
    """Return the numbers of the points that none beats in both, by rising rate: fewer bytes, and a better value."""
    sign = 1.0 if less else -1.0
    front: list[int] = []
    for k in sorted(range(len(rates)), key=lambda each: (rates[each], sign * values[each])):
        if not front or sign * values[k] < sign * values[front[-1]]:
            front.append(k)
    return front


def _draw_points(panel: Any, points: Sequence[TradeOffPoint], less: bool) -> None:
    places = place_bytes(panel, [each.bytes_per_s for each in points], _NAMES_DECADES)
    means = [each.value.mean for each in points]
    front = pareto_front([each.bytes_per_s for each in points], means, less)
    steps = {"drawstyle": "steps-post", "color": "0.45", "lw": 1, "zorder": 1}  # more bytes bring nothing in between
    panel.plot([places[k] for k in front], [points[k].shown for k in front], "--", **steps)
    shown: dict[str, str] = {}
    for place, point in zip(places, points, strict=True):
        below, above = point.whiskers
        color, bar = point.look.color, (point.shown - below, point.shown + above)
        panel.vlines(place, *bar, color=color, alpha=0.4, lw=1.4, zorder=2)
        word, marker = _SENT.get(point.sends, _OTHER)
        panel.plot(place, point.shown, marker=marker, ms=_MARKER_PT, color=color, mec="white", mew=0.5, ls="", zorder=3)
        shown |= {word: marker} if word else {}
    for word, marker in shown.items():
        panel.plot([], [], marker=marker, ms=_MARKER_PT, color=GREY, ls="", label=f"sends {word}")
    panel.plot([], [], "--", color="0.45", lw=1, label="Pareto front")
    panel.legend(loc="lower right")


def _label(figure: Figure, panel: Any, points: Sequence[TradeOffPoint]) -> None:
    """Write the names beside the markers, with lines to those that had to move."""
    figure.draw_without_rendering()  # so that the axes are where they will be
    to_pt = 72 / figure.dpi
    places = [line.get_xydata()[0] for line in panel.get_lines() if line.get_zorder() == 3]
    spots = panel.transData.transform(places) * to_pt
    area = panel.get_window_extent().get_points().ravel() * to_pt
    legend = panel.get_legend().get_window_extent().get_points().ravel() * to_pt
    whiskers = [
        panel.transData.transform([(x, point.value.low), (x, point.value.high)]) * to_pt
        for (x, _), point in zip(places, points, strict=True)
        if any(point.whiskers)
    ]
    half = _MARKER_PT / 2
    taken = [[x - half, y - half, x + half, y + half] for x, y in spots]
    bars = [[low[0] - 1, low[1], high[0] + 1, high[1]] for low, high in whiskers]
    sizes = np.array([_size_of(point.label) for point in points])
    beside = lay_out(spots, sizes, np.array([*taken, legend]), np.array(bars), area)
    back = panel.transData.inverted()
    backing = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.4}
    look = {"fontsize": _LABEL_PT, "va": "center_baseline", "zorder": 4, "bbox": backing}
    for point, spot, size, place in zip(points, spots, sizes, beside, strict=True):
        x, y = back.transform(place / to_pt)
        panel.text(x, y, point.label, **look).set_in_layout(False)
        if abs(place[1] - spot[1]) > 1:
            end = place if place[0] > spot[0] else np.add(place, (size[0], 0.0))
            line = back.transform(np.array([spot, end]) / to_pt)
            panel.plot(*line.T, color="0.6", lw=0.5, zorder=1.5, scalex=False, scaley=False)


def _size_of(name: str) -> tuple[float, float]:
    """Return width and height of a label in points."""
    from matplotlib.textpath import TextPath

    return float(TextPath((0, 0), name, size=_LABEL_PT).get_extents().width) + 2, _LABEL_PT * _LINE_HEIGHT


_LEVEL_PT, _MOVED_PT = 6.0, 22.0
"""Distances of a label from its marker, where it is level with it, and where a line leads to it from above or below."""

_LINES, _CLOSE = 60, 14
"""Farthest that a label is moved up or down, in quarters of its height, at all and so as to keep off whiskers."""


def lay_out(points: Floats, sizes: Floats, taken: Floats, whiskers: Floats, bounds: Floats) -> Floats:
    """Place a label beside each point, the highest point first: to its right or left, as near as there is room.

    A label that would be far away lies on whiskers instead. Where there is no room at all, it is to the right of its
    point and may lie on other labels. All is in points of 1/72 inch, y upwards; boxes are left, low, right, high.

    Args:
        points: (N, 2) x and y of the markers.
        sizes: (N, 2) width and height of the labels.
        taken: (M, 4) boxes to be kept free, as the markers'.
        whiskers: (K, 4) boxes to be kept free if possible.
        bounds: (4,) box of the area.

    Returns:
        (N, 2) the left end and the middle of the height of each label.
    """
    placed = np.empty((len(points), 2))
    used = [*np.asarray(taken, dtype=np.float64).reshape(-1, 4)]
    avoided = [*np.asarray(whiskers, dtype=np.float64).reshape(-1, 4)]
    for k in sorted(range(len(points)), key=lambda each: (-points[each, 1], points[each, 0], each)):
        candidates = _candidates(points[k], sizes[k])
        close = 2 + 4 * (_CLOSE - 2)  # the level ones, and four for each step up and down
        clear = (each for each in candidates[:close] if _is_free(_box(each, sizes[k]), [*used, *avoided], bounds))
        free = (each for each in candidates if _is_free(_box(each, sizes[k]), used, bounds))
        placed[k] = next(clear, next(free, candidates[0]))
        used.append(_box(placed[k], sizes[k]))
    return placed


def _candidates(point: Floats, size: Floats) -> list[Floats]:
    """Return places for a label: level with its marker, then ever farther above and below, right before left."""
    width, height = size
    shifts = [sign * k * height / 4 for k in range(2, _LINES) for sign in (1, -1)]
    level = [(point[0] + _LEVEL_PT, point[1]), (point[0] - _LEVEL_PT - width, point[1])]
    moved = [(x, point[1] + shift) for shift in shifts for x in (point[0] + _MOVED_PT, point[0] - _MOVED_PT - width)]
    return [np.array(each) for each in (*level, *moved)]


def _box(place: Floats, size: Floats) -> Floats:
    return np.array([place[0], place[1] - size[1] / 2, place[0] + size[0], place[1] + size[1] / 2])


def _is_free(box: Floats, used: Sequence[Floats], bounds: Floats) -> bool:
    inside = box[0] >= bounds[0] and box[1] >= bounds[1] and box[2] <= bounds[2] and box[3] <= bounds[3]
    return bool(inside) and not any(_overlap(box, other) for other in used)


def _overlap(one: Floats, other: Floats) -> bool:
    return bool(one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3])
