"""The curves of a training as SVG."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.learn.training_log import read_log
from coopsim.support.files import write_whole

CURVES = "curves.svg"
"""Name of the file in a training's folder."""

_POINTS = 200


def write_curves(folder: Path) -> Path:
    """Draw losses and values of held-out places over the steps of a training's log. Return the file's path."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    lines = read_log(folder)
    kinds = [kind for kind in ("losses", "validation") if any(line["kind"] == kind for line in lines)]
    text = io.StringIO()
    # No date and no random ids: the same training gives the same file.
    with rc_context({"svg.hashsalt": "coopsim", "svg.fonttype": "none", "font.size": 9, "text.parse_math": False}):
        figure = Figure(figsize=(1.2 + 4.2 * max(1, len(kinds)), 3.2), layout="constrained")
        for place, kind in enumerate(kinds):
            _draw(figure.add_subplot(1, len(kinds), place + 1), _thinned(lines, kind), kind)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "coopsim"})
    return write_whole(folder / CURVES, text.getvalue())


def _thinned(lines: Sequence[Mapping[str, Any]], kind: str) -> list[dict[str, float]]:
    """Return the lines of a kind, of many the means of as many neighbours as make at most `_POINTS`."""
    found = [{key: value for key, value in line.items() if key != "kind"} for line in lines if line["kind"] == kind]
    each = -(-len(found) // _POINTS)
    groups = [found[k : k + each] for k in range(0, len(found), each)]
    return [
        {
            name: sum(line[name] for line in group) / len(group)
            for name in group[0]
            if all(name in line for line in group)
        }
        for group in groups
    ]


def _draw(panel: Any, lines: Sequence[Mapping[str, float]], kind: str) -> None:
    names = dict.fromkeys(name for line in lines for name in line if name != "step")
    for name in names:
        points = [(line["step"], line[name]) for line in lines if name in line]
        panel.plot(*zip(*points, strict=True), label=name, linewidth=1, marker="." if len(points) < 30 else None)
    panel.set(xlabel="steps", title="losses" if kind == "losses" else "held-out places")
    if kind == "losses":
        panel.set_yscale("log")
    panel.legend(fontsize=7, frameon=False)
    panel.grid(alpha=0.3)
