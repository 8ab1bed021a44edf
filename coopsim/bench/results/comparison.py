"""Comparison of two sets of results, cell by cell: which differences are larger than chance would explain."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.results.result_table import Samples, named, samples_of
from coopsim.bench.results.statistics import (
    LEVEL,
    Interval,
    bootstrap_difference,
    holm,
    rate_difference,
    sign_flip_p_value,
    smallest_p_value,
)
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import is_yes_no, less_is_better
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.support.checks import require_choice

DEFAULT_METRICS = (PRIMARY_METRIC, "HOTA", "crash")
"""Few, because every further comparison makes each difference harder to show. Where no car is driven there is no crash.
"""


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference between B and A in one metric, over the seeds that both have, or over their drawn places.

    Attributes:
        policy: policy of both sides.
        condition: condition; None for the mean over all conditions of each seed.
        metric: name of the metric.
        before: mean of A.
        after: mean of B.
        change: mean of B - A with its interval; the ends are infinite with too few seeds.
        identical: True if all differences are exactly 0.
        p_bootstrap: p-value of the paired bootstrap over seeds; NaN for rates.
        p_sign_flip: p-value of the exact test, which is valid for any number of seeds: McNemar's for rates.
        p_corrected: the larger of the two, corrected for the number of comparisons by Holm's method; identical rows are
            no comparisons, and have 1.
        p_possible: smallest corrected p-value that so many seeds allow, if every difference were clear.
    """

    policy: str
    condition: Condition | None
    metric: str
    before: float
    after: float
    change: Interval
    identical: bool
    p_bootstrap: float
    p_sign_flip: float
    p_corrected: float = 1.0
    p_possible: float = 1.0

    @property
    def is_rate(self) -> bool:
        """True if yes or no is compared, by McNemar's test; False for means."""
        return math.isnan(self.p_bootstrap)

    @property
    def p_value(self) -> float:
        """The larger of the known p-values, not corrected."""
        return self.p_sign_flip if self.is_rate else max(self.p_bootstrap, self.p_sign_flip)

    @property
    def significant(self) -> bool:
        """True if the corrected p-value is at most `LEVEL`."""
        return self.p_corrected <= LEVEL

    @property
    def verdict(self) -> str:
        """The finding about B: "better", "worse", "identical", "too few seeds" or "not significant"."""
        if self.significant:
            return "better" if (self.change.mean > 0) != less_is_better(self.metric) else "worse"
        if self.identical:
            return "identical"
        return "too few seeds" if self.p_possible > LEVEL else "not significant"


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All differences between A and B.

    Attributes:
        differences: differences by policy and metric; first over all conditions, then of each condition.
        matched: number of cells with values on both sides.
        unmatched: cells or values that a side lacks, that failed, or that are of two places, each with the reason.
        samples: independent samples that the seeds make.
    """

    differences: tuple[Difference, ...]
    matched: int
    unmatched: tuple[str, ...]
    samples: Samples

    @property
    def compared(self) -> int:
        """The number of comparisons that p-values are corrected for: of all differences that are not identical."""
        return sum(not row.identical for row in self.differences)


def compare_results(
    before: Sequence[CellResult], after: Sequence[CellResult], metrics: Sequence[str] | None = None
) -> Comparison:
    """Compare two sets of results, whose cells are matched by policy, condition, seed and length.

    The metrics are by default those of `DEFAULT_METRICS` that the results have.

    Raises:
        InvalidValueError: no cell has values on both sides, or a cell is twice on a side.
        UnknownNameError: neither side has such a metric.
    """
    sides = _by_cell(before), _by_cell(after)
    matched, unmatched = _match(*sides)
    if not matched:
        some = "; ".join(unmatched[:3])
        raise InvalidValueError(f"A and B have no finished cell in common{f': {some}' if some else ''}")
    known = {name for both in matched.values() for result in both for name in result.values}
    for name in metrics or ():
        require_choice("metric", name, known)
    chosen = tuple(metrics or ()) or tuple(name for name in DEFAULT_METRICS if name in known)
    if not chosen:
        raise UnknownNameError("metric", DEFAULT_METRICS[0], known)
    seeds = sorted({cell.seed for cell in matched})
    samples = samples_of([each for both in matched.values() for each in both], seeds)
    sample_of = dict(zip(seeds, samples.group.tolist(), strict=True))
    rows: list[Difference] = []
    for policy in sorted({cell.policy for cell in matched}):
        mine = {cell: both for cell, both in matched.items() if cell.policy == policy}
        name = named(policy, bound=any(result.bound for both in mine.values() for result in both))
        for metric in chosen:
            rows += _differences(name, metric, mine, sample_of, unmatched)
    if not rows:
        raise InvalidValueError(f"no pair of runs has a value of {' or '.join(chosen)} on both sides")
    return Comparison(_corrected(rows), len(matched), tuple(unmatched), samples)


def as_one_policy(results: Iterable[CellResult], policy: str, name: str) -> list[CellResult]:
    """Select the results of one policy and rename it, so that two policies can be compared.

    Raises:
        UnknownNameError: there are no results of the policy.
    """
    everything = list(results)
    require_choice("policy of the results", policy, {result.cell.policy for result in everything})
    return [
        replace(result, cell=replace(result.cell, policy=name)) for result in everything if result.cell.policy == policy
    ]


def name_of(cell: Cell) -> str:
    """Describe a cell in words."""
    where, length = cell.condition, f"{cell.frames} frames" if cell.frames else "whole episode"
    connected = "" if where.penetration is None else f"penetration {where.penetration:g}, "
    lies = "" if not where.attacks else f"attacks {where.attacks}, "
    return (
        f"{cell.policy}, {where.scenario}, latency {where.latency_s * 1000:g} ms, loss {where.loss:g}, "
        f"noise {where.position_noise_m:g} m and {where.heading_noise_deg:g} degrees, "
        f"bandwidth {where.bandwidth_bit_s:g} bit/s, {connected}{lies}seed {cell.seed}, {length}"
    )


_Both = tuple[CellResult, CellResult]


def _by_cell(results: Sequence[CellResult]) -> dict[Cell, CellResult]:
    cells: dict[Cell, CellResult] = {}
    for result in results:
        if result.cell in cells:
            raise InvalidValueError(
                f"each cell must be there once, got two of {name_of(result.cell)}; results of two versions of a policy "
                "or of other options need folders of their own"
            )
        cells[result.cell] = result
    return cells


def _match(before: Mapping[Cell, CellResult], after: Mapping[Cell, CellResult]) -> tuple[dict[Cell, _Both], list[str]]:
    matched: dict[Cell, _Both] = {}
    unmatched = []
    for cell in sorted({*before, *after}):
        faults = [
            fault
            for side, results in (("A", before), ("B", after))
            for fault in ([f"not in {side}"] if cell not in results else [f"failed in {side}"] * results[cell].failed)
        ]
        if not faults:
            faults = _other_place(before[cell].place_seed, after[cell].place_seed)
        if faults:
            unmatched.append(f"{name_of(cell)}: {' and '.join(faults)}")
        else:
            matched[cell] = before[cell], after[cell]
    return matched, unmatched


def _other_place(before: int | None, after: int | None) -> list[str]:
    """Say that the runs of a cell were in two drawn places, so that their difference would be one of places."""
    if before == after:
        return []
    names = ["no drawn place" if seed is None else f"place {seed}" for seed in (before, after)]
    return [f"in {names[0]} in A but in {names[1]} in B"]


def _differences(
    policy: str, metric: str, matched: Mapping[Cell, _Both], sample_of: Mapping[int, int], unmatched: list[str]
) -> list[Difference]:
    """Return the rows of one metric, not yet corrected; cells without a value are added to `unmatched`."""
    conditions = sorted({cell.condition for cell in matched})
    by_seed: dict[int, dict[Condition, tuple[float, float]]] = defaultdict(dict)
    for cell, (before, after) in matched.items():
        values = before.values.get(metric, np.nan), after.values.get(metric, np.nan)
        lacking = [side for side, value in zip("AB", values, strict=True) if not np.isfinite(value)]
        if lacking:
            unmatched.append(f"{name_of(cell)}: no {metric} in {' and '.join(lacking)}")
        else:
            by_seed[cell.seed][cell.condition] = values
    rows = []
    for condition in conditions:
        found = {seed: values[condition] for seed, values in sorted(by_seed.items()) if condition in values}
        if found:
            rows.append(_difference(policy, condition, metric, _by_sample(found, sample_of)))
    if len(conditions) > 1:
        every = {seed: list(each.values()) for seed, each in sorted(by_seed.items()) if len(each) == len(conditions)}
        whole = {seed: np.mean(values, axis=0) for seed, values in every.items()}
        if whole:
            rows.insert(0, _difference(policy, None, metric, _by_sample(whole, sample_of)))
        else:
            unmatched.append(f"{policy}: no seed has {metric} in all conditions, so there is no row for all")
    return rows


def _corrected(rows: Sequence[Difference]) -> tuple[Difference, ...]:
    """Return the rows with p-values corrected for the number of those that are not identical."""
    compared = [k for k, row in enumerate(rows) if not row.identical]
    found = holm(np.array([rows[k].p_value for k in compared]))
    possible = holm(np.array([smallest_p_value(rows[k].change.count, is_rate=rows[k].is_rate) for k in compared]))
    corrected = list(rows)
    for k, p_corrected, p_possible in zip(compared, found.tolist(), possible.tolist(), strict=True):
        corrected[k] = replace(rows[k], p_corrected=p_corrected, p_possible=p_possible)
    return tuple(corrected)


def _by_sample(by_seed: Mapping[int, Any], sample_of: Mapping[int, int]) -> Floats:
    """Return the mean values (N, 2) of the seeds of each sample."""
    samples: dict[int, list[Any]] = defaultdict(list)
    for seed, values in by_seed.items():
        samples[sample_of[seed]].append(values)
    return np.array([each[0] if len(each) == 1 else np.mean(each, axis=0) for each in samples.values()])


def _difference(policy: str, condition: Condition | None, metric: str, both: Floats) -> Difference:
    """Compute a row from values (N, 2) of A and B, one pair per sample."""
    change = both[:, 1] - both[:, 0]
    before, after = both.mean(axis=0).tolist()
    rates = rate_difference(both[:, 0], both[:, 1]) if is_yes_no(metric) else None
    if rates is not None:
        interval, p_bootstrap, p_sign_flip = rates[0], math.nan, rates[1]
    else:
        interval, p_bootstrap = bootstrap_difference(change)
        p_sign_flip = sign_flip_p_value(change)
    identical = not change.any()
    return Difference(policy, condition, metric, before, after, interval, identical, p_bootstrap, p_sign_flip)
