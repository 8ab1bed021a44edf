"""Measure what rankings of messages are worth at equal bytes: rows, a table and a Pareto plot.

    python scripts/measure_messages.py ROWS.csv [--selections need,score,random] [--seeds 800-805] [--svg PARETO.svg]

Each seed of `town` is a drawn town; `--places crossing,highway` takes other environments. Rows that the file has are
not run again, so what was interrupted goes on; `--seeds ""` runs nothing and reports all rows of the file. Each ranking
may be a spec, such as `learned(weights=mine.safetensors)`. "when2com" is the rule of `examples/21_learn_what_to_say.py`
with the handshake of `--handshake FILE`, which that example writes; its budget is the least with which it sends no
fewer bytes than "score" in the same place with seed 500. Its requests take none: they are made of messages sent anyway.
"""

from __future__ import annotations

import argparse
import csv
import runpy
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import coopsim
from coopsim.bench.results.statistics import mean_interval
from coopsim.geometry.se3 import Floats
from coopsim.viz.charts import COLUMN_IN, draw_series, policy_styles, to_svg

CONDITIONS: dict[str, dict[str, Any]] = {
    **{f"{size} bytes": {"budget_bytes": size} for size in (110, 150, 240, 400)},
    "150 bytes, half lost": {"budget_bytes": 150, "loss": 0.5},
    "150 bytes, 8 cars": {"budget_bytes": 150, "connected_cars": 8},
}
FIELDS = ("policy", "place", "condition", "selection", "seed", "sAMOTA", "bytes_per_s")
EXAMPLE = Path(__file__).parents[1] / "examples" / "21_learn_what_to_say.py"
OBJECT_BYTES, TUNING_SEED, HEIGHT_IN = 33, 500, 2.9
Key = tuple[str, str, str, str, int]
Rows = dict[Key, tuple[float, float]]


def main() -> None:
    """Read the arguments, run what is missing, print, draw."""
    parser = argparse.ArgumentParser(description="Measure rankings of messages.")
    parser.add_argument("rows", type=Path)
    parser.add_argument("--selections", default="need,score,random")
    parser.add_argument("--seeds", default="800-805")
    parser.add_argument("--policy", default="late_fusion")
    parser.add_argument("--places", default="town")
    parser.add_argument("--conditions", default=";".join(CONDITIONS), help="separated by semicolons")
    parser.add_argument("--handshake", type=Path)
    parser.add_argument("--svg", type=Path)
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1) if first else range(0)
    selections, places = args.selections.split(","), args.places.split(",")
    if args.handshake is not None:
        runpy.run_path(str(EXAMPLE))["load_handshake"](args.handshake)
    rows = read(args.rows)
    for seed in seeds:
        for place, condition in ((place, condition) for place in places for condition in args.conditions.split(";")):
            for selection in selections:
                key = (args.policy, place, condition, selection, seed)
                if key not in rows:
                    rows[key] = measured(*key)
                    append(args.rows, key, rows[key])
    for line in table(rows, args.policy, places, selections):
        print(line)
    if args.svg is not None:
        draw(rows, args.policy, places, selections, args.svg)


def measured(policy: str, place: str, condition: str, selection: str, seed: int) -> tuple[float, float]:
    """Return sAMOTA, and bytes a second of an agent, in 50 frames."""
    options = dict(CONDITIONS[condition])
    if selection == "when2com":
        options["budget_bytes"] = equal_bytes(place, condition)
    return run(policy, place, seed, selection=selection, **options)


def run(policy: str, place: str, seed: int, **options: Any) -> tuple[float, float]:
    """Return sAMOTA, and bytes a second of an agent."""
    score = coopsim.evaluate(policy, place, seed=seed, lidar=None, max_cycles=50, **options).score
    return score["sAMOTA"], score["bytes_per_s"]


@cache
def equal_bytes(place: str, condition: str) -> int:
    """Return the least budget with which When2com's rule sends no fewer bytes than the highest scores do."""
    options = dict(CONDITIONS[condition])
    budget = options.pop("budget_bytes")

    def sent(selection: str, size: int) -> float:
        return run("late_fusion", place, TUNING_SEED, selection=selection, budget_bytes=size, **options)[1]

    wanted, sizes = sent("score", budget), range(budget, 3 * budget, OBJECT_BYTES)
    return next((size for size in sizes if sent("when2com", size) >= wanted), sizes[-1])


def read(path: Path) -> Rows:
    """Return the rows of a file; none if there is no file."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {
            (row["policy"], row["place"], row["condition"], row["selection"], int(row["seed"])): (
                float(row["sAMOTA"]),
                float(row["bytes_per_s"]),
            )
            for row in csv.DictReader(file)
        }


def append(path: Path, key: Key, values: tuple[float, float]) -> None:
    """Add a row to a file, with the header if it is new."""
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([FIELDS] * new + [(*key, *(round(value, 3) for value in values))])


def table(rows: Rows, policy: str, places: list[str], selections: list[str]) -> Iterator[str]:
    """Yield lines of Markdown: the first ranking's mean, and its lead over each other, paired by place and seed."""
    others = "".join(f" less {each} |" for each in selections[1:])
    yield f"| condition | places | {selections[0]} |{others} bytes/s per agent |"
    yield "| -- |" + " -- |" * (len(selections) + 2)
    for condition in CONDITIONS:
        found = complete(rows, policy, places, condition, selections)
        if not len(found):
            continue
        score, sent = found[:, :, 0], found[:, :, 1].mean(axis=0)
        leads = (mean_interval(score[:, 0] - each) for each in score.T[1:])
        told = "".join(f" {lead.mean:+.1f} [{lead.low:+.1f}, {lead.high:+.1f}] |" for lead in leads)
        least, most = (f"{round(each):,}" for each in (sent.min(), sent.max()))
        sizes = least if least == most else f"{least} to {most}"
        yield f"| {condition} | {len(found)} | {score[:, 0].mean():.1f} |{told} {sizes} |"


def complete(rows: Rows, policy: str, places: list[str], condition: str, selections: list[str]) -> Floats:
    """Return the values (P, S, 2) of all rankings where every one was measured."""
    drawn = sorted({(key[1], key[4]) for key in rows if key[0] == policy and key[1] in places and key[2] == condition})
    keys = [[(policy, place, condition, each, seed) for each in selections] for place, seed in drawn]
    return np.array([[rows[key] for key in these] for these in keys if all(key in rows for key in these)])


def draw(rows: Rows, policy: str, places: list[str], selections: list[str], path: Path) -> None:
    """Draw mean sAMOTA over mean bytes a second, a line for each ranking."""
    budgets = [each for each, options in CONDITIONS.items() if set(options) == {"budget_bytes"}]
    found = [complete(rows, policy, places, each, selections) for each in budgets]
    means = np.array([each.mean(axis=0) for each in found if len(each)])
    path.write_text(
        to_svg(lambda figure: draw_lines(figure, means, selections), COLUMN_IN, HEIGHT_IN), encoding="utf-8"
    )


def draw_lines(figure: Figure, means: Floats, selections: list[str]) -> None:
    """Draw means (B, S, 2) of sAMOTA and bytes a second: B budgets, S selections."""
    axes, looks = figure.subplots(), policy_styles(selections)
    for (name, look), line in zip(looks.items(), np.moveaxis(means, 1, 0), strict=True):
        draw_series(axes, line[:, 1], line[:, 0], np.full((len(line), 2), np.nan), look)
        axes.get_lines()[-1].set_label(name)
    axes.set(xlabel="bytes a second of an agent", ylabel="sAMOTA")
    axes.legend(loc="lower right")


if __name__ == "__main__":
    main()
