"""Pictures of what steps cost."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from stepping import StepTimes

from coopsim.viz.charts import COLORS, COLUMN_IN, GREY, PAGE_IN, policy_styles, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Costs = Mapping[int, Mapping[str, StepTimes]]
"""By number of what there is more and more of, and by threads."""

_COLORS, _LIMIT = {"1": GREY, "2": COLORS[0]}, COLORS[1]
_REAL_TIME_MS = 100.0


def plot_costs(path: Path, costs: Mapping[str, Costs]) -> None:
    """Write the picture: a panel for each of `costs`, by what is counted along its axis."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(costs), sharey=True)
        for panel, (what, cost) in zip(panels, costs.items(), strict=True):
            for threads, color in _COLORS.items():
                label = f"{threads} thread{'s' * (threads != '1')}"
                times = [row[threads].least_ms for row in cost.values()]
                panel.loglog(list(cost), times, marker="o", markersize=4, color=color, label=label)
            panel.axhline(_REAL_TIME_MS, color=_LIMIT, linewidth=0.8, linestyle="--")
            panel.set_xlabel(what)
            panel.set_xticks(list(cost), [_short(number) for number in cost])
            panel.set_yticks([2, 5, 10, 20, 50, 100, 200], ["2", "5", "10", "20", "50", "100", "200"])
            panel.minorticks_off()
        above = {"textcoords": "offset points", "color": _LIMIT}
        panels[0].annotate("real time, 10 frames/s", (1, _REAL_TIME_MS), (0, 3), **above)
        panels[0].set_ylabel("ms a step")
        panels[0].legend(loc="lower right")

    path.write_text(to_svg(draw, PAGE_IN, 2.6), encoding="utf-8")


def plot_policies(path: Path, costs: Mapping[str, Mapping[int, float]]) -> None:
    """Write the picture of `costs`: milliseconds of a receiver's frame, by policy and by messages in the frame."""
    styles = policy_styles(list(costs))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        messages = list(next(iter(costs.values())))
        for policy, cost in costs.items():
            style = styles[policy].matplotlib
            panel.loglog(messages, list(cost.values()), **style, markersize=4, label=policy)
            linear = [cost[messages[-1]] * number / messages[-1] for number in messages]
            panel.loglog(messages, linear, color=style["color"], linewidth=0.8, linestyle=":")
        panel.loglog([], [], color="black", linewidth=0.8, linestyle=":", label="in proportion to messages")
        panel.set(xlabel="messages to a receiver in a frame", ylabel="ms a receiver and frame")
        panel.set_xticks(messages, [str(number) for number in messages])
        ticks = (0.1, 0.2, 0.5, 1, 2, 5, 10)
        panel.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.legend()

    path.write_text(to_svg(draw, COLUMN_IN, 2.6), encoding="utf-8")


def _short(number: int) -> str:
    """As 64k for 65536, 1M for 1048576."""
    for factor, unit in ((2**20, "M"), (2**10, "k")):
        if number >= factor:
            return f"{number // factor}{unit}"
    return str(number)
