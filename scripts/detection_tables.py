"""The tables and the figure of a measurement by measure_detection.py."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import mean, stdev
from typing import Any

from tabulate import tabulate

from coopsim.bench.detect.detect import EVERYWHERE
from coopsim.bench.report.formats import line_style, to_svg

CLEAN = "clean"
MESSAGES_PER_S = 10
PARTS = ("ms_environment", "ms_uplink", "ms_policy")

Row = dict[str, Any]


def tables(rows: Sequence[Row], protocols: Sequence[Row], methods: Mapping[str, str]) -> str:
    """Return the tables as Markdown."""
    pooled = {(row["study"], row["policy"]): row for row in rows if row["environment"] == EVERYWHERE}
    clean = {name: pooled[CLEAN, policy] for name, policy in methods.items() if (CLEAN, policy) in pooled}
    titles = list(dict.fromkeys(title for title, _ in pooled))
    parts = ["## APBEV@0.5 / @0.7 of vehicles\n\n" + _main(pooled, titles, methods)]
    if seeds := _seeds(pooled, titles, methods):
        parts.append("## APBEV@0.5 / @0.7 by training seeds: mean and standard deviation\n\n" + seeds)
    columns = (
        "APBEV@0.3", "APBEV@0.5 own", "APBEV@0.5 others_only", "recall others_only", "recall", "false_per_frame",
        "APBEV@0.3 people", "APBEV@0.3 riders", "APBEV@0.5 0-30m", "APBEV@0.5 30-50m", "APBEV@0.5 50-100m", "AP3D@0.7",
    )  # fmt: skip
    parts.append("## Clean\n\n" + _columns(clean, columns))
    parts.append("## Cost, ms a frame of all agents\n\n" + _columns(clean, PARTS))
    places = list(dict.fromkeys(row["environment"] for row in rows if row["environment"] != EVERYWHERE))
    by_place = {(row["environment"], row["policy"]): row for row in rows if row["study"] == CLEAN}
    cells = [
        [name, *(_ap(by_place.get((place, policy)), ("APBEV@0.5",)) for place in places)]
        for name, policy in methods.items()
    ]
    parts.append("## APBEV@0.5 by place, clean\n\n" + _table(cells, ("", *places)))
    others = {(row["protocol"], row["policy"]): row for row in protocols}
    wanted = {"opencood": "APBEV@0.5", "dair": "APBEV@0.5", "nuscenes": "mAP", "v2x-real": "mAPBEV@0.5"}
    cells = [
        [name, _ap(clean.get(name), ("APBEV@0.5",))]
        + [_ap(others.get((protocol, policy)), (metric,)) for protocol, metric in wanted.items()]
        for name, policy in methods.items()
    ]
    heads = ("", "coopsim APBEV@0.5", *(f"{protocol} {metric}" for protocol, metric in wanted.items()))
    parts.append("## The same boxes by other protocols\n\n" + _table(cells, heads))
    return "\n\n".join(parts) + "\n"


def _main(pooled: Mapping[tuple[str, str], Row], titles: Sequence[str], methods: Mapping[str, str]) -> str:
    cells = []
    for name, policy in methods.items():
        clean = pooled.get((CLEAN, policy))
        size = "-" if clean is None else f"{clean['bytes_per_message']:,.0f}"
        cells.append([name, size, *(_ap(pooled.get((title, policy)), ("APBEV@0.5", "APBEV@0.7")) for title in titles)])
    sizes = {title: {row["frames"] for (of, _), row in pooled.items() if of == title} for title in titles}
    heads = [f"{title} ({'/'.join(map(str, sorted(sizes[title])))} frames)" for title in titles]
    return _table(cells, ("", "bytes", *heads))


def _seeds(pooled: Mapping[tuple[str, str], Row], titles: Sequence[str], methods: Mapping[str, str]) -> str:
    """Return the table of the methods that were trained several times: "attention", "attention, seed 1", ..."""
    cells = []
    for name in methods:
        trained = [policy for title, policy in methods.items() if title == name or title.startswith(f"{name}, seed ")]
        if len(trained) < 2:
            continue
        row = [name]
        for title in titles:
            rows = [pooled[title, policy] for policy in trained if (title, policy) in pooled]
            values = [[row[metric] for row in rows] for metric in ("APBEV@0.5", "APBEV@0.7")]
            row.append(" / ".join(f"{mean(each):.3f} +- {stdev(each):.3f}" for each in values) if rows[1:] else "-")
        cells.append([*row, str(len(trained))])
    return _table(cells, ("", *titles, "seeds")) if cells else ""


def _ap(row: Row | None, metrics: Sequence[str]) -> str:
    if row is None:
        return "-"
    text = "/".join("-" if row.get(metric) is None else f"{row[metric]:.3f}" for metric in metrics)
    ends = row["intervals"].get(metrics[0])
    return text if ends is None else f"{text} ({ends[0]:.2f}-{ends[1]:.2f})"


def _columns(rows: Mapping[str, Row], columns: Sequence[str]) -> str:
    cells = [
        [name, *("-" if row.get(each) is None else f"{row[each]:.{1 if each[:2] == 'ms' else 3}f}" for each in columns)]
        for name, row in rows.items()
    ]
    return _table(cells, ("", *columns))


def _table(cells: Sequence[Sequence[str]], heads: Sequence[str]) -> str:
    align = ["left"] + ["right"] * (len(heads) - 1)
    return tabulate(cells, headers=heads, tablefmt="github", colalign=align, disable_numparse=True)


def figure(rows: Sequence[Row], methods: Mapping[str, str]) -> str:
    """Draw average precision over bytes a second of each sender, under budgets: all on the same frames."""

    def draw(made: Any) -> None:
        panel = made.subplots()
        for number, (name, policy) in enumerate(methods.items()):
            measured = [row for row in rows if row["environment"] == EVERYWHERE and row["policy"] == policy]
            limited = [row for row in measured if row["group"] == "bytes"]
            shown = limited or [row for row in measured if row["study"] == CLEAN]  # what sends nothing has no budget
            places = sorted((row["bytes_per_message"] * MESSAGES_PER_S, row["APBEV@0.5"]) for row in shown)
            if not places:
                continue
            style, color = line_style(number)
            if places[-1][0] == 0:
                panel.axhline(places[-1][1], color=color, ls=":", label=name)
                continue
            panel.plot(*zip(*places, strict=True), f"o{style}", color=color, ms=4, label=name)
        panel.set_xscale("log")
        panel.set(xlabel="bytes a second, of each sender", ylabel="APBEV@0.5, vehicles")
        panel.grid(alpha=0.25)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(fontsize=7, frameon=False)

    return to_svg(draw, 6.0, 4.0)
