"""The ranking of policies in one metric, with the worst condition of each."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from coopsim.bench.grid.axes import mildest
from coopsim.bench.grid.cell import Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import Interval
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES, less_is_better


@dataclass(frozen=True, slots=True)
class Standing:
    """One policy in the ranking by one metric.

    Attributes:
        policy: its name.
        rank: from 1; None for a policy that lacks a value in some cell where another has one, as its mean is over other
            cells than the others'.
        mean: over conditions, with its interval over seeds or drawn places.
        undisturbed: mean over seeds and scenarios in the mildest conditions; NaN if the grid has none.
        worst: mean over seeds in the policy's worst condition.
        worst_condition: the policy's worst condition; None without values.
        bytes_per_s: mean over all its cells.
        failed: number of its failed cells.
        missing: number of its cells that were not run.
    """

    policy: str
    rank: int | None
    mean: Interval
    undisturbed: float
    worst: float
    worst_condition: Condition | None
    bytes_per_s: float
    failed: int
    missing: int


def standings(table: ResultTable, metric: str) -> tuple[Standing, ...]:
    """Rank all policies, the best first and those without a rank last.

    Raises:
        UnknownNameError: there is no such metric.
    """
    values = table.values(metric)
    rates = table.values(BYTES) if BYTES in table.metrics else np.full(values.shape, math.nan)
    less = less_is_better(metric)
    entries = [_standing(table, k, values[k], rates[k], less) for k in range(len(table.policies))]
    whole = np.flatnonzero(table.whole(metric)).tolist()
    order = sorted(whole, key=lambda k: entries[k].mean.mean * (1 if less else -1))
    means = [entries[k].mean.mean for k in order]
    ranked = [replace(entries[k], rank=1 + means.index(entries[k].mean.mean)) for k in order]
    return (*ranked, *(entry for k, entry in enumerate(entries) if k not in whole))


def _standing(table: ResultTable, policy: int, values: Floats, rates: Floats, less: bool) -> Standing:
    by_condition = known_mean(values, axis=1)
    calm = [table.conditions.index(each) for each in mildest(table.conditions)]
    worst = None
    if not np.isnan(by_condition).all():
        worst = int(np.nanargmax(by_condition) if less else np.nanargmin(by_condition))
    name = table.policies[policy]
    failed = sum(result.cell.policy == name for result in table.failures)
    return Standing(
        policy=name,
        rank=None,
        mean=table.samples.interval(known_mean(values, axis=0)),
        undisturbed=float(known_mean(by_condition[calm], axis=0)),
        worst=math.nan if worst is None else float(by_condition[worst]),
        worst_condition=None if worst is None else table.conditions[worst],
        bytes_per_s=float(known_mean(rates.ravel(), axis=0)),
        failed=failed,
        missing=int((~table.finished[policy]).sum()) - failed,
    )


def known_mean(values: Floats, axis: int) -> Floats:
    """Average the values that are not NaN; NaN where all are."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of means without values
        mean: Floats = np.nanmean(values, axis=axis)
    return mean
