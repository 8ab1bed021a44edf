"""Draw the plots of results' pages from the numbers that stand beside them, in the style of `coopsim.viz.charts`.

    python scripts/draw_results.py [PLOT ...] [--out docs/results]

PLOT is of `PLOTS`; all of them without one. `docs/results/plots.csv` has the numbers: a line for each mark with its
plot, panel, series, place, value, and the ends of its interval if it has one. Those of `sAMOTA_over_bytes` are in the
first table of `docs/results/all_methods.md`.
"""

from __future__ import annotations

import argparse
import csv
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from coopsim.bench.paper.trade_off_plot import TradeOffPoint, plot_trade_off
from coopsim.bench.results.statistics import Interval
from coopsim.catalog import PolicySpec
from coopsim.geometry.se3 import Floats
from coopsim.support.files import write_whole
from coopsim.viz.charts import (
    COLUMN_IN,
    GREY,
    PAGE_IN,
    Look,
    draw_series,
    label_ends,
    legend_below,
    policy_styles,
    to_svg,
)

RESULTS = Path(__file__).parents[1] / "docs" / "results"
REAL_TIME_MS = 100.0
TOWNS = "mean over 12 drawn towns"

Series = Mapping[str, Floats]
"""Marks (N, 4) by name: place, value, and the ends of its interval, NaN where it has none."""


def read_plot(plot: str, path: Path = RESULTS / "plots.csv") -> dict[str, dict[str, Floats]]:
    """Return the series of a plot, by panel."""
    found: defaultdict[str, defaultdict[str, list[list[float]]]] = defaultdict(lambda: defaultdict(list))
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["plot"] == plot:
                marks = [float(row[name] or "nan") for name in ("x", "y", "low", "high")]
                found[row["panel"]][row["series"]].append(marks)
    return {panel: {name: np.array(marks) for name, marks in series.items()} for panel, series in found.items()}


def draw_lines(panel: Any, series: Series, looks: Mapping[str, Look]) -> list[tuple[str, Look, float, float]]:
    """Draw series into a panel; return the name, the look, and the end of each."""
    for name, marks in series.items():
        draw_series(panel, marks[:, 0], marks[:, 1], marks[:, 2:], looks[name])
    return [(name, looks[name], *marks[-1, :2].tolist()) for name, marks in series.items()]


def latency() -> str:
    """Draw what late boxes cost, by what is done with them."""
    parts = read_plot("latency")
    looks = policy_styles([f"late_fusion(delayed={name})" for name in parts["crossing"]])
    named = dict(zip(parts["crossing"], looks.values(), strict=True))

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(parts), sharey=True)
        for panel, (title, series) in zip(panels, parts.items(), strict=True):
            ends = draw_lines(panel, series, named)
            panel.set(title=title, xlabel="latency, ms", ylim=(0, 80))
        panels[0].set_ylabel("sAMOTA")
        label_ends(panels[-1], ends, 2.1)

    return to_svg(draw, PAGE_IN, 2.7)


def policy_speed() -> str:
    """Draw how a policy's time grows with the messages that it receives."""
    ((_, series),) = read_plot("policy_speed").items()
    looks = policy_styles([*series])

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        ends = draw_lines(panel, series, looks)
        for _, look, x, y in ends:
            places = series["late_fusion"][:, 0]
            panel.plot(places, y * places / x, ":", color=look.color, lw=0.9, zorder=1)
        panel.set(
            xscale="log", yscale="log", xlabel="messages to a receiver in a frame", ylabel="ms a receiver and frame"
        )
        _ticks(panel, series["late_fusion"][:, 0], [0.1, 0.2, 0.5, 1, 2, 5, 10])
        panel.set_ylim(0.1, 10)
        label_ends(panel, ends, 2.2)

    return to_svg(draw, COLUMN_IN + 0.8, 2.8)


def speed() -> str:
    """Draw the time of a step over agents, rays and vehicles."""
    parts = read_plot("speed")
    looks = {"1 thread": Look(GREY, 0, 0), "2 threads": policy_styles(["no_fusion", "one"])["one"]}

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(parts), sharey=True)
        for panel, (title, series) in zip(panels, parts.items(), strict=True):
            draw_lines(panel, series, looks)
            panel.axhline(REAL_TIME_MS, color="0.45", ls="--", lw=0.9)
            panel.set(xscale="log", yscale="log", xlabel=title)
            _ticks(panel, series["1 thread"][:, 0], [5, 10, 20, 50, 100, 200])
        panels[0].set_ylabel("ms a step")
        panels[0].set_ylim(4, 200)
        panels[0].text(1.0, 1.05 * REAL_TIME_MS, "real time, 10 frames/s", va="bottom")
        legend_below(figure, looks)

    return to_svg(draw, PAGE_IN, 2.9)


def detection_bytes() -> str:
    """Draw average precision over the bytes that a sender may send."""
    ((_, series),) = read_plot("detection_bytes").items()
    own = {"none": "no_fusion", "late": "late_fusion", "early": "early_fusion", "AttFuse": "attfuse"}
    looks = dict(zip(series, policy_styles([own.get(name, name) for name in series]).values(), strict=True))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        draw_lines(panel, {name: marks for name, marks in series.items() if name != "none"}, looks)
        panel.axhline(series["none"][0, 1], color=looks["none"].color, ls=":", lw=1.3)
        panel.set(xscale="log", xlabel="bytes a second, of each sender", ylabel="AP@0.5 from above, vehicles")
        panel.set_xticks([1e4, 1e5, 1e6], ["10 k", "100 k", "1 M"])
        panel.minorticks_off()
        legend_below(figure, looks | {"none": Look(looks["none"].color, 2, looks["none"].marker)})

    return to_svg(draw, PAGE_IN, 4.2)


def all_methods() -> str:
    """Draw every method's sAMOTA over its bytes."""
    rows = list(first_table((RESULTS / "all_methods.md").read_text(encoding="utf-8")))
    policies = [row[0].strip("`") for row in rows]
    looks = policy_styles(policies)
    points = [
        TradeOffPoint(name, looks[name], _sends(name), float(row[1].replace(",", "")), _alone(float(row[2])))
        for name, row in zip(policies, rows, strict=True)
    ]
    return plot_trade_off([_short(each, policies) for each in points], "sAMOTA", TOWNS)


def first_table(page: str) -> Iterator[list[str]]:
    """Yield the rows of a page's first table with bytes, without its head."""
    lines = page.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("| policy | bytes/s |")) + 2
    for line in lines[first:]:
        if not line.startswith("|"):
            return
        yield [cell.strip() for cell in line.strip("|").split("|")]


def _short(point: TradeOffPoint, policies: list[str]) -> TradeOffPoint:
    """Return a point without the parameters of its name, where none other is then called alike."""
    bare = [re.sub(r"\(.*", "", name) for name in policies]
    short = re.sub(r",? ?delayed=\w+", "", point.name).replace("()", "")
    mine = re.sub(r"\(.*", "", point.name)
    name = mine if bare.count(mine) == 1 else short
    return TradeOffPoint(name, point.look, point.sends, point.bytes_per_s, point.value)


def _sends(policy: str) -> str:
    needs = getattr(PolicySpec.parse(policy).policy_class(), "needs", None)
    return str(getattr(needs, "uplink", "") or "")


def _alone(mean: float) -> Interval:
    return Interval(mean, math.nan, math.nan, 1)


def _ticks(panel: Any, places: Floats, heights: list[float]) -> None:
    panel.set_xticks(places, [_word(each) for each in places.tolist()])
    panel.set_yticks(heights, [f"{each:g}" for each in heights])
    panel.minorticks_off()


def _word(number: float) -> str:
    """Return a number as people write it: "64 k" for 65,536."""
    steps = [(2**20, " M"), (2**10, " k"), (1, "")]
    return next(f"{number / step:g}{unit}" for step, unit in steps if number >= step)


PLOTS: Mapping[str, Callable[[], str]] = {
    "latency": latency,
    "policy_speed": policy_speed,
    "speed": speed,
    "detection_bytes": detection_bytes,
    "sAMOTA_over_bytes": all_methods,
}
"""The plots, by the names of their files."""


def main() -> None:
    """Read the arguments, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plots", nargs="*", choices=[*PLOTS, []], help=f"of {', '.join(PLOTS)}; default: all")
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args()
    for name in given.plots or PLOTS:
        write_whole(given.out / f"{name}.svg", PLOTS[name]())


if __name__ == "__main__":
    main()
