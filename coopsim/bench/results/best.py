"""Each policy beside the best one: intervals, and whether the best is significantly better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.samples import Samples
from coopsim.bench.results.standings import known_mean
from coopsim.bench.results.statistics import LEVEL, Interval, bootstrap_difference, holm, sign_flip_p_value
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import less_is_better


@dataclass(frozen=True, slots=True)
class BesideBest:
    """A policy's value beside that of the best policy.

    Attributes:
        interval: the mean with its interval over seeds, or over drawn places; NaN without values.
        complete: the policy has a value with every seed in every condition; others are compared with nobody.
        best: no complete policy has a better mean.
        p_corrected: of the paired difference to the best policy, by Holm's method for all complete policies but that
            one; NaN for the best policy itself, and where nothing is compared.
    """

    interval: Interval
    complete: bool = False
    best: bool = False
    p_corrected: float = math.nan

    @property
    def unbeaten(self) -> bool:
        """Whether the best policy is another, and not significantly better than this one."""
        return self.complete and not self.best and self.p_corrected > LEVEL


def beside_best(table: ResultTable, metric: str, conditions: Sequence[int]) -> tuple[BesideBest, ...]:
    """Compare every policy with the best one, by the mean of a metric over some conditions.

    Differences are paired by sample. The p-value of each is the larger of the bootstrap's and the sign flips', as in
    `coopsim.bench.results.comparison`. They are corrected for the number of policies, not of metrics and conditions:
    each call asks one question, which policies are as good as the best.

    Args:
        table: the results.
        metric: name of the metric.
        conditions: their numbers in the table.

    Returns:
        In the order of `table.policies`.

    Raises:
        UnknownNameError: there is no such metric.
    """
    values = table.values(metric)[:, list(conditions)]
    complete = [not np.isnan(row).any() for row in values]
    by_seed = known_mean(values, axis=1)
    intervals = [table.samples.interval(row) for row in by_seed]
    if not any(complete):
        return tuple(BesideBest(interval) for interval in intervals)
    sign = -1.0 if less_is_better(metric) else 1.0
    goods = [sign * interval.mean if whole else -math.inf for interval, whole in zip(intervals, complete, strict=True)]
    best = int(np.argmax(goods))
    others = [k for k, whole in enumerate(complete) if whole and k != best]
    corrected = dict(zip(others, _corrected(by_seed[others], by_seed[best], table.samples), strict=True))
    return tuple(
        BesideBest(interval, complete[k], goods[k] == goods[best], corrected.get(k, math.nan))
        for k, interval in enumerate(intervals)
    )


def _corrected(others: Floats, best: Floats, samples: Samples) -> list[float]:
    """Return corrected p-values of the differences between values (P, S) and (S,)."""
    differences = samples.average(best - others)
    p_values = [max(bootstrap_difference(row)[1], sign_flip_p_value(row)) for row in differences]
    return list(map(float, holm(np.array(p_values))))
