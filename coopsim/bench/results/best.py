"""Each policy beside the best one: intervals, and whether the best is significantly better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import known_mean
from coopsim.bench.results.statistics import LEVEL, Interval, largest_difference_p_values, mean_interval
from coopsim.metrics.built_in import less_is_better


@dataclass(frozen=True, slots=True)
class BesideBest:
    """A policy's value beside that of the best policy.

    Attributes:
        interval: the mean with its interval over seeds, or over drawn places; NaN without values.
        complete: the policy has a value with every seed in every condition; others are compared with nobody.
        best: no complete policy has a better mean.
        p_corrected: of the paired difference to the best policy, corrected for the number of complete policies and for
            the choice of the best among them; NaN for the best policy itself, and where nothing is compared.
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

    Differences are paired by sample, and tested all together (`largest_difference_p_values`), because the best one is
    chosen from the same values: tested each by itself, one of 29 equal policies would be called worse in one of five
    tables. They are corrected for the number of policies, not of metrics and conditions: each call asks one question,
    which policies are as good as the best.

    Args:
        table: the results.
        metric: name of the metric.
        conditions: their numbers in the table.

    Returns:
        In the order of `table.policies`.

    Raises:
        UnknownNameError: there is no such metric.
    """
    values, complete = table.values(metric)[:, list(conditions)], table.whole(metric, conditions)
    by_sample = table.samples.average(known_mean(values, axis=1))
    intervals = [mean_interval(row) for row in by_sample]
    if not complete.any():
        return tuple(BesideBest(interval) for interval in intervals)
    sign = -1.0 if less_is_better(metric) else 1.0
    goods = [sign * interval.mean if whole else -math.inf for interval, whole in zip(intervals, complete, strict=True)]
    best, compared = int(np.argmax(goods)), np.flatnonzero(complete)
    known = by_sample[compared][:, ~np.isnan(by_sample[best])]
    p_values = np.full(len(values), math.nan)
    p_values[compared] = largest_difference_p_values(sign * known, int(np.searchsorted(compared, best)))
    p_values[best] = math.nan
    return tuple(
        BesideBest(interval, bool(complete[k]), goods[k] == goods[best], float(p_values[k]))
        for k, interval in enumerate(intervals)
    )
