"""Charts in one style: colours of policies, series with light intervals, labels, and SVG files that a paper prints.

Reports draw theirs in the browser with the same looks. Matplotlib is loaded when the first chart is drawn.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.geometry.se3 import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMN_IN, PAGE_IN = 3.5, 7.16
"""Widths of a figure in one column of a paper, and in both."""

GREY = "#7b828a"
COLORS = ("#1e8bd6", "#ef5f12", "#a23be8", "#17a06a", "#9b5b3b")
"""Colours with a contrast of 3:1 to white and to the dark page, apart for the colour-blind, too."""

MARKERS = ("o", "s", "D", "^", "v", "X")
_DASHES = ("-", "--", ":")
_INK, _LINE = "#3b4148", "#e2e5e8"

_OWN = {"no_fusion": 0, "late_fusion": 1, "coop_fuse": 2, "dino_codt_tracking": 3, "early_fusion": 4, "attfuse": 5}
"""Numbers of looks that belong to a policy; 0 is grey: it sends nothing."""

_STYLE: Mapping[str, Any] = {
    "svg.hashsalt": "coopsim", "svg.fonttype": "none", "text.parse_math": False, "font.size": 8,
    "axes.titlesize": 8, "axes.labelsize": 8, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "legend.fontsize": 7.5,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#9aa1a8", "axes.linewidth": 0.7,
    "axes.grid": True, "axes.axisbelow": True, "grid.color": _LINE, "grid.linewidth": 0.7, "legend.frameon": False,
    "text.color": _INK, "axes.labelcolor": _INK, "xtick.color": _INK, "ytick.color": _INK, "lines.linewidth": 1.3,
}  # fmt: skip


def to_svg(draw: Callable[[Figure], object], width_in: float, height_in: float) -> str:
    """Return as SVG what a function draws on a matplotlib figure of a size in inches.

    Text stays text, and the same drawing gives the same bytes.
    """
    from cycler import cycler
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    text = io.StringIO()
    # No date and no random ids: the same numbers give the same file.
    style: Any = {**_STYLE, "axes.prop_cycle": cycler(color=COLORS)}
    with rc_context(style):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(figure)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "coopsim"})
    return text.getvalue()


@dataclass(frozen=True, slots=True)
class Look:
    """Look of a series in every chart.

    Attributes:
        color: colour as "#rrggbb".
        dash: number of the dash: 0 is solid.
        marker: number in `MARKERS`.
    """

    color: str
    dash: int
    marker: int

    @property
    def matplotlib(self) -> dict[str, Any]:
        """Arguments of matplotlib's `plot`."""
        return {"color": self.color, "ls": _DASHES[self.dash], "marker": MARKERS[self.marker]}


def policy_styles(policies: Sequence[str]) -> dict[str, Look]:
    """Return the look of each policy: well-known ones have the same everywhere, the others those that are left.

    Of several variants of a well-known policy one has its look: the plain one, or else that which replays late
    messages. The first 15 looks differ.
    """
    numbers: dict[str, int] = {}
    for name in sorted(policies, key=lambda each: ("(" in each, not each.endswith("(delayed=replay)"))):
        number = _OWN.get(name.partition("(")[0])
        if number is not None and number not in numbers.values():
            numbers[name] = number
    left = iter([k for k in range(1, len(policies) + len(_OWN) + 1) if k not in numbers.values()])
    return {name: _look(numbers[name] if name in numbers else next(left)) for name in policies}


def _look(number: int) -> Look:
    if number == 0:
        return Look(GREY, 0, len(MARKERS) - 1)
    turn, place = divmod(number - 1, len(COLORS))
    return Look(COLORS[place], turn % len(_DASHES), (place + turn) % len(MARKERS))


def draw_series(panel: Any, places: Floats, means: Floats, ends: Floats, look: Look, *, lines: bool = True) -> None:
    """Draw means (N,) at places (N,), in front of their intervals: `ends` (N, 2), NaN where there is none."""
    known = np.isfinite(ends).all(axis=1)
    panel.vlines(places[known], *ends[known].T, color=look.color, alpha=0.4, lw=1.4, zorder=2)
    style = {**look.matplotlib, **({} if lines else {"ls": ""})}
    panel.plot(places, means, **style, ms=4.2, mec="white", mew=0.5, zorder=3)


def limit_height(panels: Sequence[Any], *, from_zero: bool = False) -> None:
    """Limit the shared vertical axis of panels to their means, and to intervals where these do not dwarf the means.

    `from_zero` begins a rate at 0, with room for a marker there.
    """
    lines = [line for panel in panels for line in panel.get_lines() if line.get_zorder() == 3]
    means = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in lines] or [np.zeros(0)])
    if not np.isfinite(means).any():
        return
    low, high = float(np.nanmin(means)), float(np.nanmax(means))
    reach = 0.6 * max(high - low, 0.05 * abs(high), 1e-9)
    bottom, top = panels[0].get_ylim()
    top = min(top, high + reach)
    panels[0].set_ylim(-0.03 * top if from_zero else max(bottom, low - reach), top)


_GAP_PT, _LETTERS, _MOST = 9.0, 20, 8


def fit_beside(names: Sequence[str]) -> bool:
    """Return whether names are few and short enough to stand at the ends of their lines, in place of a legend."""
    return len(names) <= _MOST and max((len(line) for name in names for line in _lines(name)), default=0) <= _LETTERS


def _lines(name: str) -> list[str]:
    """Return a name as lines: a long one is broken where its parameters begin."""
    bare, bracket, parameters = name.partition("(")
    return [bare.strip(), bracket + parameters] if bracket and len(name) > _LETTERS else [name]


def label_ends(panel: Any, ends: Sequence[tuple[str, Look, float, float]], height_in: float) -> None:
    """Write names to the right of a panel, level with the ends (x, y) of their lines or moved apart.

    `height_in` is about the height of the panel, whose limits must be set.
    """
    known = [each for each in ends if math.isfinite(each[3])]
    panel.get_ylim()  # settles limits that matplotlib has yet to choose
    to_share = panel.transScale + panel.transLimits  # of the height, on logarithmic scales, too
    shares = np.array([to_share.transform((x, y))[1] for _, _, x, y in known])
    gap = _GAP_PT * max((len(_lines(each[0])) for each in known), default=1) / 72 / height_in
    for (name, look, x, y), share, place in zip(known, shares, spread(shares, gap), strict=True):
        arrow = {"arrowstyle": "-", "color": look.color, "lw": 0.6, "shrinkA": 0, "shrinkB": 3}
        moved = {"arrowprops": arrow} if abs(place - share) > 0.01 else {}
        look_of_text = {"color": look.color, "va": "center", "fontsize": 7.5, "annotation_clip": False}
        words = "\n".join(_lines(name))
        panel.annotate(words, (x, y), (1.04, place), textcoords="axes fraction", **look_of_text, **moved)


def spread(places: Floats, gap: float) -> Floats:
    """Return places (N,) from 0 to 1, moved as little as keeps them in order and, if there is room, `gap` apart."""
    order = np.argsort(places, kind="stable")
    steps = gap * np.arange(len(places))
    # Places less their steps must rise: the nearest such sequence from below and from above, and their mean.
    rest = places[order] - steps
    rest = (np.maximum.accumulate(rest) + np.minimum.accumulate(rest[::-1])[::-1]) / 2
    found = np.empty(len(places))
    found[order] = np.clip(rest, 0.0, max(0.0, 1.0 - gap * (len(places) - 1))) + steps
    return found


def legend_below(figure: Figure, names: Mapping[str, Look], *, lines: bool = True) -> None:
    """Put a legend of names below all panels of a figure."""
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], **{**look.matplotlib, **({} if lines else {"ls": ""})}, ms=4.2) for look in names.values()]
    columns = max(1, int(figure.get_figwidth() * 72 / (4.4 * max(map(len, names)) + 36)))
    figure.legend(marks, list(names), loc="outside lower center", ncols=min(columns, len(names)))


_LEVEL_LETTERS = 14
"""Most letters of a name that is written level on an axis."""


def name_ticks(panel: Any, names: Sequence[str]) -> None:
    """Put names at 0, 1, 2, ... of a panel's horizontal axis: level, or slanted where they would overlap."""
    slanted = len(names) > 1 and max(map(len, names)) > _LEVEL_LETTERS
    look = {"rotation": 20, "ha": "right", "rotation_mode": "anchor"} if slanted else {}
    panel.set_xticks(range(len(names)), names, **look)
    panel.set_xlim(-0.5, len(names) - 0.5)


_UNITS = ("", " k", " M", " G", " T")


def place_bytes(panel: Any, rates: Sequence[float], after: float = 0.3) -> list[float]:
    """Make the horizontal axis of a panel one of bytes per second, and return where each of `rates` stands on it.

    A policy that sends nothing stands on the left, apart from the logarithmic scale. `after` is the room to the right
    of the last tick, in decades.
    """
    sent = [rate for rate in rates if rate > 0]
    first, last = (math.floor(math.log10(min(sent))), math.ceil(math.log10(max(sent)))) if sent else (0, 1)
    silent = 10.0 ** (first - 0.5)
    panel.set_xscale("log")
    ticks = {10.0**power: _word(power) for power in range(first, last + 1)}
    if len(sent) < len(rates):
        panel.axvline(10.0 ** (first - 0.15), color="0.8", lw=0.8)
        ticks = {silent: "0", **ticks}
    panel.set_xlim(10.0 ** (first - 1), 10.0 ** (last + after))
    panel.set_xticks(list(ticks), list(ticks.values()))
    panel.set_xticks([], minor=True)
    return [rate or silent for rate in rates]


def _word(power: int) -> str:
    """Return a power of ten as people write it, as "10 k"; matplotlib's own labels are formulas."""
    unit = min(max(power // 3, 0), len(_UNITS) - 1)
    return f"{10.0 ** (power - 3 * unit):g}{_UNITS[unit]}"
