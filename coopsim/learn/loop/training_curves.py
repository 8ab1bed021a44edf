"""The curves of a training as SVG."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.learn.loop.training_log import mean_values, read_log
from coopsim.support.files import write_whole

CURVES = "curves.svg"
"""Name of the file in a training's folder."""

_POINTS = 200
_LOSSES = "losses"


def write_curves(folder: Path) -> Path:
    """Draw losses and values of held-out places over the steps of a training's log. Return the file's path."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    panels = _panels(read_log(folder))
    text = io.StringIO()
    # No date and no random ids: the same training gives the same file.
    with rc_context({"svg.hashsalt": "coopsim", "svg.fonttype": "none", "font.size": 9, "text.parse_math": False}):
        figure = Figure(figsize=(4.6 * max(1, len(panels)), 3.2), layout="constrained")
        for place, (title, curves) in enumerate(panels.items()):
            _draw(figure.add_subplot(1, len(panels), place + 1), title, curves)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "coopsim"})
    return write_whole(folder / CURVES, text.getvalue())


def _panels(lines: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, list[tuple[float, float]]]]:
    """Return (step, value) by panel and name; losses that fall below zero have a panel without logarithms."""
    losses, held_out = (_curves(_thinned(lines, kind)) for kind in ("losses", "validation"))
    positive = {name: points for name, points in losses.items() if min(value for _, value in points) > 0}
    negative = {name: points for name, points in losses.items() if name not in positive}
    panels = {_LOSSES: positive, "losses that may be negative": negative, "held-out places": held_out}
    return {title: curves for title, curves in panels.items() if curves}


def _curves(lines: Sequence[Mapping[str, float]]) -> dict[str, list[tuple[float, float]]]:
    names = dict.fromkeys(name for line in lines for name in line if name != "step")
    return {name: [(line["step"], line[name]) for line in lines if name in line] for name in names}


def _thinned(lines: Sequence[Mapping[str, Any]], kind: str) -> list[dict[str, float]]:
    """Return the lines of a kind, of many the means of as many neighbours as make at most `_POINTS`."""
    found = [line for line in lines if line["kind"] == kind]
    each = max(1, -(-len(found) // _POINTS))
    return [mean_values(found[k : k + each]) for k in range(0, len(found), each)]


def _draw(panel: Any, title: str, curves: Mapping[str, Sequence[tuple[float, float]]]) -> None:
    for name, points in curves.items():
        panel.plot(*zip(*points, strict=True), label=name, linewidth=1, marker="." if len(points) < 30 else None)
    panel.set(xlabel="steps", title=title)
    if title == _LOSSES:
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter("{x:g}")  # numbers as text: formulas would show their source
        panel.yaxis.set_minor_formatter("")
    panel.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    panel.grid(alpha=0.3)
