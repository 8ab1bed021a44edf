"""Pictures of what steps cost."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from stepping import StepTimes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Costs = Mapping[int, Mapping[str, StepTimes]]
"""By number of what there is more and more of, and by threads."""

_COLORS = {"1": "#8a8f98", "2": "#1f6feb"}
_REAL_TIME_MS = 100.0


def plot_costs(path: Path, costs: Mapping[str, Costs]) -> None:
    """Write the picture: a panel for each of `costs`, by what is counted along its axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.4), layout="constrained")
    panels = figure.subplots(1, len(costs), sharey=True)
    for panel, (what, cost) in zip(panels, costs.items(), strict=True):
        for threads, color in _COLORS.items():
            label = f"{threads} thread{'s' * (threads != '1')}"
            times = [row[threads].least_ms for row in cost.values()]
            panel.loglog(list(cost), times, marker="o", markersize=4, color=color, label=label)
        panel.axhline(_REAL_TIME_MS, color="#c0392b", linewidth=0.8, linestyle="--")
        panel.set_xlabel(what)
        panel.set_xticks(list(cost), [_short(number) for number in cost])
        panel.set_yticks([2, 5, 10, 20, 50, 100, 200], ["2", "5", "10", "20", "50", "100", "200"])
        panel.minorticks_off()
        panel.grid(alpha=0.3, linewidth=0.4)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].annotate(
        "real time, 10 frames/s", (1, _REAL_TIME_MS), (0, 3), textcoords="offset points", color="#c0392b", fontsize=8
    )
    panels[0].set_ylabel("ms a step")
    panels[0].legend(frameon=False, loc="lower right")
    _save(figure, path)


def plot_policies(path: Path, costs: Mapping[str, Mapping[int, float]]) -> None:
    """Write the picture of `costs`: milliseconds of a receiver's frame, by policy and by messages in the frame."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    panel = figure.subplots()
    for (policy, cost), color in zip(costs.items(), _COLORS.values(), strict=True):
        messages = list(cost)
        (line,) = panel.loglog(messages, list(cost.values()), marker="o", markersize=4, color=color, label=policy)
        linear = [cost[messages[-1]] * number / messages[-1] for number in messages]
        panel.loglog(messages, linear, color=line.get_color(), linewidth=0.8, linestyle=":")
    panel.loglog([], [], color="black", linewidth=0.8, linestyle=":", label="in proportion to messages")
    panel.set_xlabel("messages to a receiver in a frame")
    panel.set_ylabel("ms a receiver and frame")
    panel.set_xticks(messages, [str(number) for number in messages])
    ticks = (0.1, 0.2, 0.5, 1, 2, 5, 10)
    panel.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()
    panel.grid(alpha=0.3, linewidth=0.4)
    panel.spines[["top", "right"]].set_visible(False)
    panel.legend(frameon=False)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    """Write a picture without date and random ids: the same figures give the same file. Text stays text."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "coopsim", "svg.fonttype": "none"}):
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None, dpi=150)


def _short(number: int) -> str:
    """As 64k for 65536, 1M for 1048576."""
    for factor, unit in ((2**20, "M"), (2**10, "k")):
        if number >= factor:
            return f"{number // factor}{unit}"
    return str(number)
