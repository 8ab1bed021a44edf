"""Compare what `coopsim detect --json` measured in two folders, place by place: means and paired differences.

    python scripts/compare_places.py streets/pillars2 streets/pillars --metrics APBEV@0.5,APBEV@0.7
    python scripts/compare_places.py streets/pillars2 streets/pillars2 --less "late_fusion(merge=nms)"

The folders have files of the same names, one for each place. The first policy of one folder is compared with the first
of the other, and so on; with `--less` all are compared with that policy of the second. Prints a table in Markdown:
means over places, the second folder's before the first's, and the first less the second with Student's 95 % interval.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from tabulate import tabulate

from coopsim.bench.results.statistics import mean_interval
from coopsim.catalog import PolicySpec
from coopsim.cli.argument_types import names
from coopsim.geometry.se3 import Floats


def main() -> None:
    """Read the arguments, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=Path, help="folder of files, one for each place")
    parser.add_argument("second", type=Path, help="folder of as many")
    parser.add_argument("--metrics", type=names, default=("APBEV@0.5", "APBEV@0.7"), metavar="A,B")
    parser.add_argument("--less", metavar="POLICY", help="of the second folder (default: the one in the same row)")
    given = parser.parse_args()
    places = sorted(path.name for path in given.first.glob("*.json"))
    if len(places) < 2 or places != sorted(path.name for path in given.second.glob("*.json")):
        parser.error("both folders must have the same two or more files *.json")
    try:
        (policies, first), (others, second) = (
            measured([folder / name for name in places], given.metrics) for folder in (given.first, given.second)
        )
        if given.less is not None:
            less = PolicySpec.parse(given.less).text
            others, second = [less] * len(policies), second[:, [others.index(less)] * len(policies)]
    except (KeyError, ValueError) as error:
        parser.error(f"no such metric or policy, or not alike: {error}")
    if len(policies) != len(others):
        parser.error(f"without --less, both must have as many policies, got {len(policies)} and {len(others)}")
    rows = [
        [policy, other, *(cell(first[:, k, at], second[:, k, at]) for at in range(len(given.metrics)))]
        for k, (policy, other) in enumerate(zip(policies, others, strict=True))
    ]
    print(tabulate(rows, headers=["", "compared with", *given.metrics], tablefmt="github"))


def measured(paths: list[Path], metrics: tuple[str, ...]) -> tuple[list[str], Floats]:
    """Return the policies' names, and their values (places, policies, metrics), NaN where there is none."""
    tables = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    policies = [row["policy"] for row in tables[0]]
    for path, rows in zip(paths, tables, strict=True):
        if [row["policy"] for row in rows] != policies:
            raise ValueError(f"{path} has other policies than {paths[0]}")
    return policies, np.array([[[row[metric] for metric in metrics] for row in rows] for rows in tables], float)


def cell(first: Floats, second: Floats) -> str:
    """Return means and the paired difference of values (P,), of the places that have both."""
    both = ~np.isnan(first) & ~np.isnan(second)
    less = difference(first - second)
    return less if less == "-" else f"{second[both].mean():.3f} -> {first[both].mean():.3f}: {less}"


def difference(values: Floats) -> str:
    """Return the mean of paired differences (N,) with its 95 % interval, as text; "-" for fewer than two known."""
    found = mean_interval(values)
    return f"{found.mean:+.3f} ({found.low:+.3f} to {found.high:+.3f})" if found.count > 1 else "-"


if __name__ == "__main__":
    main()
