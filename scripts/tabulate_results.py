"""Make a page's table or figure of what `coopsim detect` and `coopsim bench` have measured.

    python scripts/tabulate_results.py clean.json "rain, 10 mm/h=rain.json" --metrics APBEV@0.5,APBEV@0.7
    python scripts/tabulate_results.py clean.json --metrics recall,false_per_frame --columns metrics
    python scripts/tabulate_results.py clean.json --columns places
    python scripts/tabulate_results.py 1kB.json 10kB.json --figure ap_over_bytes.svg
    python scripts/tabulate_results.py results/compact --metrics sAMOTA,AMOTA --columns metrics

A run is a file of `coopsim detect --json` or a folder of `coopsim bench`; a title may stand before it. A row is a
policy, or all policies of one title (`--policy "Where2comm=where2comm(weights=seed1.safetensors)"`). Of detections,
brackets hold 95 % intervals over episodes, and several trainings have mean and standard deviation. Of benchmarks,
numbers are means over all places and seeds with half of Student's 95 % interval, or with their standard error.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import numpy as np
from tabulate import tabulate

from coopsim.bench.detect.detect import EVERYWHERE
from coopsim.bench.grid.labels import varying_axes
from coopsim.bench.results.statistics import mean_interval
from coopsim.bench.text.forms import form_of
from coopsim.catalog import PolicySpec
from coopsim.cli.argument_types import names
from coopsim.cli.arguments import stored_results
from coopsim.support.files import write_whole
from coopsim.viz.charts import PAGE_IN, policy_styles, to_svg

MESSAGES_PER_S = 10
"""Messages that each agent sends in the usual environments, of 0.1 s a frame."""


@dataclass
class Measured:
    """The numbers of a policy in a run and a place.

    Attributes:
        run: title of the run, with the disturbance where it has several.
        values: a value of each episode, or one of all of them, by metric.
        intervals: ends of 95 % intervals, by metric.
        form: format of the numbers.
    """

    run: str
    policy: str
    place: str
    values: dict[str, list[float | None]] = field(default_factory=lambda: defaultdict(list))
    intervals: dict[str, list[float]] = field(default_factory=dict)
    form: str | None = None


def main() -> None:
    """Read the arguments and the runs, print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="[TITLE=]PATH", help="files of `detect`, folders of `bench`")
    parser.add_argument("--metrics", type=names, default=("APBEV@0.5",), metavar="A,B")
    parser.add_argument("--columns", choices=("runs", "metrics", "places"), default="runs")
    parser.add_argument("--policy", action="append", default=[], metavar="TITLE=POLICY", help="a row (default: all)")
    parser.add_argument("--standard-error", action="store_true", help="of benchmarks' means, in place of intervals")
    parser.add_argument("--figure", type=Path, metavar="SVG", help="APBEV@0.5 over bytes a second, of detections")
    given = parser.parse_args()
    measured = [each for run in given.runs for each in read(run)]
    titles = titles_of(given.policy, measured)
    print(table(measured, titles, given))
    if given.figure is not None:
        write_whole(given.figure, figure(measured, titles))


def read(run: str) -> list[Measured]:
    """Return the numbers of a run in each place, and in all places together."""
    title, equals, named = run.partition("=")
    path = Path(run) if Path(run).exists() or not equals else Path(named)
    title = title if equals and path == Path(named) else path.stem
    return list(_read_detections(title, path) if path.is_file() else _read_benchmark(title, path))


def _read_detections(title: str, path: Path) -> Iterator[Measured]:
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    several = {name for name in ("noise", "delay_ms") if len({row[name] for row in rows}) > 1}
    pooled = any(row["environment"] == EVERYWHERE for row in rows)
    for row in rows:
        run = " ".join([title, *(f"{row[name]:g} ms" if name == "delay_ms" else row[name] for name in several)])
        values = {name: [value] for name, value in row.items() if value is None or isinstance(value, (int, float))}
        for place in (row["environment"], *([] if pooled else [EVERYWHERE])):
            yield Measured(run, row["policy"], place, values, row["intervals"])


def _read_benchmark(title: str, folder: Path) -> Iterator[Measured]:
    results = [each for each in stored_results(folder) if not each.failed]
    axes = varying_axes([each.cell.condition for each in results])
    found: dict[tuple[str, str, str], Measured] = {}
    for result in results:
        cell = result.cell
        run = " ".join([title, *(axis.text(cell.condition) for axis in axes)])
        for place in (cell.condition.scenario, EVERYWHERE):
            mine = found.setdefault((run, cell.policy, place), Measured(run, cell.policy, place, form=".1f"))
            for name, value in result.values.items():
                mine.values[name].append(value)
    yield from found.values()


def titles_of(given: Sequence[str], measured: Sequence[Measured]) -> dict[str, list[str]]:
    """Return the policies of each row by its title, in order; all policies, each by its own name, if none is given."""
    titles: dict[str, list[str]] = defaultdict(list)
    for each in given:
        title, _, policy = each.partition("=")
        titles[title].append(PolicySpec.parse(policy).text)
    return titles or {policy: [policy] for policy in dict.fromkeys(each.policy for each in measured)}


def table(measured: Sequence[Measured], titles: dict[str, list[str]], given: argparse.Namespace) -> str:
    """Return the table in Markdown."""
    runs = list(dict.fromkeys(each.run for each in measured))
    places = list(dict.fromkeys(each.place for each in measured if each.place != EVERYWHERE))
    columns = {
        "runs": [(run, EVERYWHERE, given.metrics) for run in runs],
        "metrics": [(run, EVERYWHERE, (metric,)) for run in runs for metric in given.metrics],
        "places": [(run, place, given.metrics) for run in runs for place in places],
    }[given.columns]
    heads = {"runs": runs, "metrics": given.metrics, "places": places}[given.columns]
    rows = []
    for title, policies in titles.items():
        cells = [
            _text([each for each in measured if (each.run, each.place) == (run, place) and each.policy in policies],
                  metrics, given)
            for run, place, metrics in columns
        ]  # fmt: skip
        for k in range(0, len(cells), len(heads)):
            name = [title] if len(cells) == len(heads) else [title, runs[k // len(heads)]]
            rows.append([*name, *cells[k : k + len(heads)]])
    heads = [*[""] * (len(rows[0]) - len(heads)), *heads]
    return tabulate(rows, heads, tablefmt="github", disable_numparse=True)


def _text(found: Sequence[Measured], metrics: Sequence[str], given: argparse.Namespace) -> str:
    """Format a cell: of several policies, mean and standard deviation over them."""
    if not found:
        return "-"
    numbers = [
        [value for each in found for value in each.values.get(metric, ()) if value is not None] for metric in metrics
    ]
    if found[0].form is not None:
        return " / ".join(_mean(each, form_of(metric), given) for metric, each in zip(metrics, numbers, strict=True))
    forms = [".3f" if name[:3] != "ms_" else ".1f" for name in metrics]
    forms = [",.0f" if name == "bytes_per_message" else form for name, form in zip(metrics, forms, strict=True)]
    if len(found) > 1:
        pairs = zip(numbers, forms, strict=True)
        return " / ".join(f"{mean(each):{form}} ± {stdev(each):{form}}" for each, form in pairs if each)
    text = "/".join(f"{each[0]:{form}}" if each else "-" for each, form in zip(numbers, forms, strict=True))
    ends = found[0].intervals.get(metrics[0]) if given.columns != "metrics" else None
    return text if ends is None else f"{text} ({ends[0]:.2f}-{ends[1]:.2f})"


def _mean(values: Sequence[float], form: str, given: argparse.Namespace) -> str:
    interval = mean_interval(np.array(values))
    if interval.count < 2:
        return format(interval.mean, form)
    error = stdev(values) / len(values) ** 0.5 if given.standard_error else interval.half_width
    return f"{interval.mean:{form}} ± {error:{form}}"


def figure(measured: Sequence[Measured], titles: dict[str, list[str]]) -> str:
    """Draw average precision over bytes a second of each sender: a line over the runs for each row."""

    def draw(made: Any) -> None:
        panel = made.subplots()
        for (title, policies), look in zip(titles.items(), policy_styles(list(titles)).values(), strict=True):
            mine = [each.values for each in measured if each.place == EVERYWHERE and each.policy in policies]
            pairs = [(each["bytes_per_message"][0], each["APBEV@0.5"][0]) for each in mine]
            points = sorted((size * MESSAGES_PER_S, ap) for size, ap in pairs if size is not None and ap is not None)
            if points and points[-1][0] == 0:
                panel.axhline(points[-1][1], color=look.color, ls=":", label=title)
            elif points:
                panel.plot(*zip(*points, strict=True), **look.matplotlib, ms=4.2, label=title)
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter("{x:,.0f}")  # numbers as text: formulas would show their source
        panel.set(xlabel="bytes a second, of each sender", ylabel="APBEV@0.5, vehicles")
        panel.legend(handlelength=3.5, loc="center left", bbox_to_anchor=(1.0, 0.5))

    return to_svg(draw, PAGE_IN, 4.0)


if __name__ == "__main__":
    main()
