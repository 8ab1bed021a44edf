"""Show how many road users of logged traffic a connected car knows in time, over the share of connected cars.

    python scripts/plot_real_traffic.py RUNS docs/results/real_traffic

RUNS is what `measure_real_traffic.py` wrote. Prints tables in Markdown; writes all curves as .csv and a figure as .svg.
If RUNS is such a .csv, the figure alone is drawn again.
Cars are connected whose number, one a car and draw, is below the share: those of a share are among those of a larger.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from tabulate import tabulate

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Mask
from coopsim.viz.charts import COLORS, GREY, PAGE_IN, to_svg

LEAST_RETURNS = 5
"""Returns from which the detector `simulated` can find an object."""

SHARES = tuple((np.arange(21) / 20).round(2).tolist())
SHOWN = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)
DRAWS, RESAMPLES = 100, 2000
FEWEST = 20
"""Encounters of a kind below which a log is left out."""

VARIANTS = ("boxes", "features", "boxes and a unit", "boxes, others' only")
COLOR_OF = dict(zip(VARIANTS, (*COLORS[:3], GREY), strict=True))

Line = Mapping[str, Any]


class Curve(NamedTuple):
    """A share of encounters over shares of connected cars, (S,) each, in per cent: mean and 95 % interval."""

    mean: Floats
    low: Floats
    high: Floats


class Known(NamedTuple):
    """Encounters of a kind in a log: how often each is known (E, S), by variant, and the group of each (E,)."""

    by_variant: dict[str, Floats]
    group: Floats


def known(lines: list[Line], groups: str, variants: tuple[str, ...]) -> Known:
    """Return how often the other of each encounter is known in time, over `DRAWS` draws of the connected cars.

    Args:
        lines: those of one kind.
        groups: "place" or "ego": what an independent sample is.
        variants: of `VARIANTS`.
    """
    names = sorted({name for line in lines for name in (line["other"], *line["others"])})
    draw = {name: stream(0, "connected", name).random(DRAWS) for name in names}
    rates = {variant: np.array([_rate(line, draw, variant) for line in lines]) for variant in variants}
    group = np.unique([str(line[groups]) for line in lines], return_inverse=True)[1]
    return Known(rates, group)


def _rate(line: Line, draw: Mapping[str, Floats], variant: str) -> Floats:
    """Return the share of draws (S,) in which the ego knows the other."""
    shares = np.array(SHARES)[:, None]
    own, others = line["own"], line["others"]
    got = np.full((len(SHARES), DRAWS), own)
    for name, count in others.items():
        sent = np.where(draw[name] < shares, count, 0)
        got = got + sent if variant == "features" else np.maximum(got, sent)
    told: Mask = got >= LEAST_RETURNS
    if variant == "boxes and a unit":
        told = told | ((line["unit"] or 0) >= LEAST_RETURNS)  # a place without a junction has none
    if line["other_is_car"] and variant != "boxes, others' only":
        told = told | (draw[line["other"]] < shares)
    return np.asarray(told.mean(axis=1))


def curve(rates: Floats, group: Floats) -> Curve:
    """Return the mean of encounters (E, S), with the bootstrap's percentiles over their groups (E,)."""
    count = np.bincount(group)
    total = np.stack([np.bincount(group, column) for column in rates.T], axis=1)
    drawn = stream(0, "bootstrap").integers(len(count), size=(RESAMPLES, len(count)))
    means = 100 * total[drawn].sum(axis=1) / count[drawn].sum(axis=1)[:, None]
    low, high = np.percentile(means, [2.5, 97.5], axis=0)
    return Curve(100 * rates.mean(axis=0), low, high)


class Part(NamedTuple):
    """A kind of encounter in a log, with its curves by variant."""

    log: str
    kind: str
    encounters: int
    groups: str
    curves: dict[str, Curve]


def parts(runs: Path) -> Iterator[Part]:
    """Yield what is known in each log, by kind of encounter."""
    for path in sorted(runs.glob("*.json")):
        facts = json.loads(path.read_text())
        rows = [json.loads(line) for line in path.with_suffix(".jsonl").read_text().splitlines()]
        groups = "place" if facts["map"] else "ego"
        variants = tuple(name for name in VARIANTS if facts["map"] or "unit" not in name)
        print(f"{facts}; {sum('own' not in row for row in rows)} without a place")
        for kind in ("conflict", "meeting"):
            lines = [row for row in rows if row["kind"] == kind and "own" in row]
            if len(lines) >= FEWEST:
                print(_missed(facts["log"], kind, lines))
                found = known(lines, groups, variants)
                curves = {name: curve(rates, found.group) for name, rates in found.by_variant.items()}
                yield Part(facts["log"], kind, len(lines), f"{found.group.max() + 1} {groups}s", curves)


def _missed(log: str, kind: str, lines: list[Line]) -> str:
    """Say what is missed alone: how much has no return at all, how far it is."""
    missed = [line for line in lines if line["own"] < LEAST_RETURNS]
    hidden = [line for line in missed if line["own"] == 0]
    away_m = [line["away_m"] for line in missed]
    return (
        f"{log}, {kind}s: {len(missed)} of {len(lines)} are missed alone, {len(hidden)} of these without a return; "
        f"median distance {np.median([line['away_m'] for line in lines]):.0f} m, of missed ones "
        f"{np.median(away_m) if away_m else np.nan:.0f} m; "
        f"of missed ones below 60 m, {sum(line['away_m'] < 60 for line in missed)}"
    )


def table(found: list[Part]) -> str:
    """Return the curves at some shares, in Markdown."""
    rows = []
    for part in found:
        for variant, line in part.curves.items():
            at = [SHARES.index(share) for share in SHOWN]
            cells = [f"{line.mean[k]:.0f} ({line.low[k]:.0f} to {line.high[k]:.0f})" for k in at]
            rows.append([f"{part.log}, {part.encounters} {part.kind}s, {part.groups}", variant, *cells])
    heads = ["log", "variant", *(f"{100 * share:.0f} %" for share in SHOWN)]
    return tabulate(rows, heads, tablefmt="github", disable_numparse=True)


def write_curves(found: list[Part], path: Path) -> None:
    """Write all curves as a table."""
    rows = ["log,encounters,variant,connected_percent,known_percent,low,high"]
    for part in found:
        for variant, line in part.curves.items():
            for share, *values in zip(SHARES, *line, strict=True):
                numbers = ",".join(f"{value:.2f}" for value in values)
                rows.append(f'{part.log},{part.kind}s,"{variant}",{100 * share:.0f},{numbers}')
    path.write_text("\n".join(rows) + "\n")


def read_curves(path: Path) -> list[Part]:
    """Read the curves of a table that `write_curves` wrote."""
    found: dict[tuple[str, str], dict[str, list[list[float]]]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            curves = found.setdefault((row["log"], row["encounters"]), {})
            curves.setdefault(row["variant"], []).append(
                [float(row[name]) for name in ("known_percent", "low", "high")]
            )
    return [
        Part(log, kind.removesuffix("s"), 0, "", {name: Curve(*np.array(rows).T) for name, rows in curves.items()})
        for (log, kind), curves in found.items()
    ]


def draw_curves(found: list[Part], path: Path) -> None:
    """Draw the curves of each log and kind in a panel of its own."""
    least = min(float(line.low.min()) for part in found for line in part.curves.values())

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, -(-len(found) // 2), sharey=True, sharex=True, squeeze=False).ravel()
        for axes, part in zip(panels, found, strict=False):
            for variant, line in part.curves.items():
                percent, color = 100 * np.array(SHARES), COLOR_OF[variant]
                axes.fill_between(percent, line.low, line.high, color=color, alpha=0.12, linewidth=0)
                axes.plot(percent, line.mean, color=color, label=variant)
            axes.set(title=f"{part.log}: {part.kind}s", xlim=(0, 100), ylim=(least - 3, 101))
        for axes in panels[: len(found)][-(len(panels) // 2) :]:
            axes.set_xlabel("connected cars, %")
            axes.tick_params(labelbottom=True)
        panels[0].set_ylabel("known 3 s before, %")
        panels[0].legend(loc="lower right")
        for axes in panels[len(found) :]:
            axes.set_axis_off()

    path.write_text(to_svg(draw, PAGE_IN, 4.8), encoding="utf-8")


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("out", type=Path, help="path of the .csv and the .svg, without its end")
    given = parser.parse_args()
    if given.runs.suffix == ".csv":
        found = read_curves(given.runs)
    else:
        found = list(parts(given.runs))
        print(table(found))
        write_curves(found, given.out.with_suffix(".csv"))
    draw_curves(found, given.out.with_suffix(".svg"))


if __name__ == "__main__":
    main()
