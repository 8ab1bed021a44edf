"""Measure what rankings of messages are worth at equal bytes: rows, a table and a Pareto plot.

    python scripts/measure_messages.py ROWS.csv [--selections need,score,random] [--seeds 800-805] [--svg PARETO.svg]

Each seed is a drawn town. Rows that the file has are not run again, so what was interrupted goes on; `--seeds ""` runs
nothing and reports all rows of the file. Each ranking may be a spec, such as `learned(weights=mine.safetensors)`.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import coopsim
from coopsim.bench.results.statistics import mean_interval

CONDITIONS: dict[str, dict[str, Any]] = {
    **{f"{size} bytes": {"budget_bytes": size} for size in (110, 150, 240, 400)},
    "150 bytes, half lost": {"budget_bytes": 150, "loss": 0.5},
    "150 bytes, 8 cars": {"budget_bytes": 150, "connected_cars": 8},
}
FIELDS = ("condition", "selection", "seed", "sAMOTA", "bytes_per_s")
Rows = dict[tuple[str, str, int], tuple[float, float]]


def main() -> None:
    """Read the arguments, run what is missing, print, draw."""
    parser = argparse.ArgumentParser(description="Measure rankings of messages.")
    parser.add_argument("rows", type=Path)
    parser.add_argument("--selections", default="need,score,random")
    parser.add_argument("--seeds", default="800-805")
    parser.add_argument("--policy", default="late_fusion")
    parser.add_argument("--svg", type=Path)
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1) if first else range(0)
    selections = args.selections.split(",")
    rows = read(args.rows)
    for seed in seeds:
        for condition, options in CONDITIONS.items():
            for selection in selections:
                if (condition, selection, seed) not in rows:
                    rows[condition, selection, seed] = measured(args.policy, selection, seed, options)
                    append(args.rows, (condition, selection, seed), rows[condition, selection, seed])
    for line in table(rows, selections):
        print(line)
    if args.svg is not None:
        draw(rows, selections, args.svg)


def measured(policy: str, selection: str, seed: int, options: dict[str, Any]) -> tuple[float, float]:
    """Return sAMOTA, and bytes a second of an agent, in 50 frames of a town."""
    score = coopsim.evaluate(policy, "town", seed=seed, lidar=None, max_cycles=50, selection=selection, **options).score
    return score["sAMOTA"], score["bytes_per_s"]


def read(path: Path) -> Rows:
    """Return the rows of a file; none if there is no file."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {
            (row["condition"], row["selection"], int(row["seed"])): (float(row["sAMOTA"]), float(row["bytes_per_s"]))
            for row in csv.DictReader(file)
        }


def append(path: Path, key: tuple[str, str, int], values: tuple[float, float]) -> None:
    """Add a row to a file, with the header if it is new."""
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([FIELDS] * new + [(*key, *(round(value, 3) for value in values))])


def table(rows: Rows, selections: list[str]) -> Iterator[str]:
    """Yield lines of Markdown: each ranking's mean, and the first one's lead over it, paired by town."""
    yield f"| condition | towns | `selection` | sAMOTA | {selections[0]} less this | bytes/s per agent |"
    yield "| -- | -- | -- | -- | -- | -- |"
    for condition in CONDITIONS:
        towns = complete(rows, condition, selections)
        if not towns:
            continue
        best = np.array([rows[condition, selections[0], seed][0] for seed in towns])
        for selection in selections:
            score, sent = np.array([rows[condition, selection, seed] for seed in towns]).T
            lead = mean_interval(best - score)
            told = "" if selection == selections[0] else f"{lead.mean:+.1f} [{lead.low:+.1f}, {lead.high:+.1f}]"
            yield f"| {condition} | {len(towns)} | {selection} | {score.mean():.1f} | {told} | {sent.mean():,.0f} |"


def complete(rows: Rows, condition: str, selections: list[str]) -> list[int]:
    """Return the towns in which every ranking was measured."""
    towns = sorted({seed for name, _, seed in rows if name == condition})
    return [seed for seed in towns if all((condition, each, seed) in rows for each in selections)]


def draw(rows: Rows, selections: list[str], path: Path) -> None:
    """Draw mean sAMOTA over mean bytes a second, a line for each ranking."""
    figure = Figure(figsize=(6, 3.5), layout="constrained")
    axes = figure.subplots()
    budgets = [each for each, options in CONDITIONS.items() if set(options) == {"budget_bytes"}]
    for selection in selections:
        known = [(each, towns) for each in budgets if (towns := complete(rows, each, selections))]
        means = np.array([np.mean([rows[each, selection, seed] for seed in towns], axis=0) for each, towns in known])
        axes.plot(means[:, 1], means[:, 0], "o-", label=selection)
    axes.set(xlabel="bytes a second of an agent", ylabel="sAMOTA")
    axes.grid(alpha=0.3)
    axes.legend(title="selection")
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
