"""Compare methods in places of maps with the same methods in drawn towns: scores, leads, and the order of methods.

    python scripts/measure_maps.py measured/towns measured/maps

Folders are of `coopsim bench`, that of drawn towns first, with the same policies and seeds. Each scenario is a world,
and a place is one sample. Leads are over one method in the same places. They are set beside those in drawn towns seed
by seed, with Student's interval; the bootstrap of rank correlations draws places of both worlds with replacement. No
command does that: `coopsim compare` compares the same cells of two folders.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rank_policies import rank_correlations
from tabulate import tabulate

from coopsim.bench.grid.cell import Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import Interval, mean_interval
from coopsim.cli.argument_types import names
from coopsim.cli.arguments import stored_results
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats

AGAINST = "late_fusion(delayed=replay)"
Scores = Mapping[str, Floats]
"""Scores (S,) by policy, in order of seeds."""


def scores_of(folders: Sequence[Path], metric: str) -> dict[str, Scores]:
    """Read the scores of each world, by the name of its scenario, of the policies that all worlds have.

    Raises:
        InvalidValueError: a world has several conditions, seeds differ, there is no common policy, or a value lacks.
    """
    tables = [ResultTable.of(stored_results(folder)) for folder in folders]
    if len(seeds := {table.seeds for table in tables}) > 1:
        raise InvalidValueError(f"all worlds must have the same seeds, got {sorted(seeds)}")
    common = [each for each in tables[0].policies if all(each in table.policies for table in tables)]
    if not common:
        raise InvalidValueError("worlds must have policies in common, got none")
    found: dict[str, Scores] = {}
    for table in tables:
        for name, values in zip(map(_name, table.conditions), table.values(metric).swapaxes(0, 1), strict=True):
            if name in found:
                raise InvalidValueError(f"{name} must be of one condition, got several")
            found[name] = {policy: values[table.policies.index(policy)] for policy in common}
            lacking = [policy for policy, row in found[name].items() if np.isnan(row).any()]
            if lacking:
                raise InvalidValueError(f"{name} lacks values of {metric}: {', '.join(lacking)}")
    return found


def _name(condition: Condition) -> str:
    return Path(condition.scenario).name.split(".")[0]


def scores_table(worlds: Mapping[str, Scores]) -> str:
    """Format the mean of each policy in each world with its interval over places; best in the first world first."""
    rows = [[policy, *(_shown(mean_interval(each[policy])) for each in worlds.values())] for policy in _order(worlds)]
    return tabulate(rows, ["policy", *worlds], tablefmt="github", disable_numparse=True)


def leads_table(worlds: Mapping[str, Scores], against: str) -> str:
    """Format leads over a method in each world and, for all worlds but the first, by how much they differ from there.

    Raises:
        InvalidValueError: the worlds lack the method.
    """
    first, *others = worlds
    if against not in worlds[first]:
        raise InvalidValueError(f"against must be one of {', '.join(worlds[first])}, got {against!r}")
    rows = []
    for policy in (each for each in _order(worlds) if each != against):
        leads = {name: scores[policy] - scores[against] for name, scores in worlds.items()}
        changes = [_shown(mean_interval(leads[name] - leads[first])) for name in others]
        rows.append([policy, *(_shown(mean_interval(lead)) for lead in leads.values()), *changes])
    heads = ["policy", *worlds, *(f"{name} - {first}" for name in others)]
    return tabulate(rows, heads, tablefmt="github", disable_numparse=True)


def orders_table(worlds: Mapping[str, Scores]) -> str:
    """Format the rank correlations of each world with the first one, over policies, with their intervals."""
    first, *others = (np.stack([worlds[name][policy] for policy in _order(worlds)], axis=1) for name in worlds)
    rows = [[name, *rank_correlations(first, other)] for name, other in zip([*worlds][1:], others, strict=True)]
    return tabulate(rows, ["", "Spearman's rho", "Kendall's tau"], tablefmt="github", disable_numparse=True)


def _order(worlds: Mapping[str, Scores]) -> list[str]:
    scores = next(iter(worlds.values()))
    return sorted(scores, key=lambda policy: -float(scores[policy].mean()))


def _shown(interval: Interval) -> str:
    return f"{interval.mean:.1f} ({interval.low:.1f} to {interval.high:.1f})"


def main() -> None:
    """Read the arguments, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", type=Path, nargs="+", help="folders of `coopsim bench`, that of drawn towns first")
    parser.add_argument("--metrics", type=names, default=("sAMOTA", "HOTA"), help="(default: sAMOTA,HOTA)")
    parser.add_argument("--against", default=AGAINST, help="method that leads are over (default: %(default)s)")
    given = parser.parse_args()
    for metric in given.metrics:
        worlds = scores_of(given.worlds, metric)
        places = len(next(iter(next(iter(worlds.values())).values())))
        print(f"{metric}, {places} places in each world", scores_table(worlds), sep="\n\n", end="\n\n")
        print(f"Leads over {given.against}", leads_table(worlds, given.against), sep="\n\n", end="\n\n")
        print("Order, beside the first world", orders_table(worlds), sep="\n\n", end="\n\n")


if __name__ == "__main__":
    main()
