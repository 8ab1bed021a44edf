"""The ranking of policies in one metric, with the worst condition of each."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coopsim.bench.grid.cell import Condition
from coopsim.bench.grid.labels import mildest
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.results.statistics import LEVEL, Interval, largest_difference_p_values
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES, less_is_better


@dataclass(frozen=True, slots=True)
class Standing:
    """Rank and values of a policy in one metric.

    Attributes:
        policy: name of the policy.
        rank: rank from 1; None for a policy that lacks a value in some cell where another has one, as its mean is over
            other cells than the others', and for an upper bound, which does not compete.
        mean: mean over conditions, with its interval over seeds or drawn places.
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
    """Rank all policies, the best first and those without a rank last."""
    values = table.values(metric)
    rates = table.values(BYTES) if BYTES in table.metrics else np.full(values.shape, math.nan)
    failed = Counter(result.cell.policy for result in table.failures)
    entries = [_standing(table, k, metric, values[k], rates[k], failed[name]) for k, name in enumerate(table.policies)]
    whole = [k for k in np.flatnonzero(table.whole(metric)).tolist() if table.policies[k] not in table.bounds]
    order = sorted(whole, key=lambda k: entries[k].mean.mean * (1 if less_is_better(metric) else -1))
    means = [entries[k].mean.mean for k in order]
    ranked = [replace(entries[k], rank=1 + means.index(entries[k].mean.mean)) for k in order]
    return (*ranked, *(entry for k, entry in enumerate(entries) if k not in whole))


def _standing(table: ResultTable, policy: int, metric: str, values: Floats, rates: Floats, failed: int) -> Standing:
    by_condition = known_mean(values, axis=1)
    calm = [table.conditions.index(each) for each in mildest(table.conditions)]
    worst = None
    if not np.isnan(by_condition).all():
        worst = int(np.nanargmax(by_condition) if less_is_better(metric) else np.nanargmin(by_condition))
    return Standing(
        policy=table.policies[policy],
        rank=None,
        mean=table.mean(metric, policy, range(len(table.conditions))),
        undisturbed=float(known_mean(by_condition[calm], axis=0)),
        worst=math.nan if worst is None else float(by_condition[worst]),
        worst_condition=None if worst is None else table.conditions[worst],
        bytes_per_s=float(known_mean(rates.ravel(), axis=0)),
        failed=failed,
        missing=int((~table.finished[policy]).sum()) - failed,
    )


@dataclass(frozen=True, slots=True)
class BestComparison:
    """A policy's value beside that of the best policy.

    Attributes:
        interval: mean with its interval over seeds, or over drawn places; NaN without values.
        complete: the policy has a value with every seed in every condition; others are not compared, nor are upper
            bounds.
        best: no complete policy has a better mean.
        p_corrected: p-value of the paired difference to the best policy, corrected for the number of complete policies
            and for the choice of the best among them; NaN for the best policy itself, and where nothing is compared.
    """

    interval: Interval
    complete: bool = False
    best: bool = False
    p_corrected: float = math.nan

    @property
    def unbeaten(self) -> bool:
        """True if the best policy is another, and not significantly better than this one."""
        return self.complete and not self.best and self.p_corrected > LEVEL


def compare_with_best(table: ResultTable, metric: str, conditions: Sequence[int]) -> tuple[BestComparison, ...]:
    """Compare every policy with the best one, by the mean of a metric over some conditions, in the order of the table.

    Differences are paired by sample, and tested all together (`largest_difference_p_values`), because the best one is
    chosen from the same values: tested each by itself, one of 29 equal policies would be called worse in one of five
    tables. They are corrected for the number of policies, not of metrics and conditions: each call asks one question,
    which policies are as good as the best.
    """
    values, complete = table.values(metric)[:, list(conditions)], table.whole(metric, conditions)
    competes = complete & ~np.isin(table.policies, list(table.bounds))
    by_seed = known_mean(values, axis=1)
    by_sample = table.samples.average(by_seed)
    intervals = [table.mean(metric, k, conditions) for k in range(len(table.policies))]
    if not competes.any():
        return tuple(BestComparison(*each) for each in zip(intervals, complete.tolist(), strict=True))
    sign = -1.0 if less_is_better(metric) else 1.0
    goods = [sign * interval.mean if whole else -math.inf for interval, whole in zip(intervals, competes, strict=True)]
    best, compared = int(np.argmax(goods)), np.flatnonzero(competes)
    known = by_sample[compared][:, ~np.isnan(by_sample[best])]
    p_values = np.full(len(values), math.nan)
    p_values[compared] = largest_difference_p_values(sign * known, int(np.searchsorted(compared, best)))
    p_values[best] = math.nan
    return tuple(
        BestComparison(interval, bool(complete[k]), goods[k] == goods[best], float(p_values[k]))
        for k, interval in enumerate(intervals)
    )
