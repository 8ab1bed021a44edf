"""Changes by messages, over paired seeds: crashes avoided and caused, where the gain ends, and predictors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coopsim.bench.films.crash_pairs import CRASH, policy_alone
from coopsim.bench.grid.axis import Axis
from coopsim.bench.grid.labels import mildest, mildest_along, values_of
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.statistics import CONFIDENCE, Interval, bootstrap_difference, rate_difference
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import is_yes_no, less_is_better
from coopsim.support.rng import stream
from coopsim.world.situations.situation import SITUATIONS

_RESAMPLES = 2000
"""Resamples of a rank correlation: its interval has two digits."""


@dataclass(frozen=True, slots=True)
class Change:
    """Difference that messages, or a lie in them, make to a metric, over paired runs.

    Attributes:
        policy: the policy with messages.
        pairs: number of pairs of runs.
        alone: mean before the change: of the policy without messages, or while all are honest.
        sharing: mean after it.
        change: mean difference, after minus before, with its interval: Newcombe's of yes or no, else a bootstrap's.
        less: pairs in which the value is less after the change: avoided crashes.
        more: pairs in which it is more: caused crashes.
        p_value: p-value of no difference: McNemar's exact one of yes or no, else the bootstrap's; not corrected.
    """

    policy: str
    pairs: int
    alone: float
    sharing: float
    change: Interval
    less: int
    more: int
    p_value: float


Pairing = Callable[[ResultTable, Floats, Sequence[int]], Floats]
"""Values (N,) of pairs from values (C, S) and the numbers of conditions: `by_world` or `by_sample`."""


def change(
    table: ResultTable, policy: int, conditions: Sequence[int], metric: str = CRASH, pairing: Pairing | None = None
) -> Change | None:
    """Compare a policy with the one that sends nothing in some conditions; None without a pair.

    A pair is that of `pairing`, by default a situation with a seed (`by_world`). Where the policy without messages was
    not run in a condition, its run in the mildest one stands for it: what messages suffer does not reach it.
    """
    alone = _without_messages(table, conditions, metric)
    if alone is None:
        return None
    pairs = pairing or by_world
    before, after = (pairs(table, each, conditions) for each in (alone, table.values(metric)[policy]))
    return compare_runs(table.policies[policy], before, after, metric)


def _without_messages(table: ResultTable, conditions: Sequence[int], metric: str) -> Floats | None:
    """Return the values (C, S) of the policy that sends nothing, as far as conditions need them; None without one."""
    base = policy_alone(table)
    if base is None or metric not in table.metrics:
        return None
    values = table.values(metric)[base]
    alone: Floats = values.copy()
    for k in conditions:
        for mild in calm(table, table.conditions[k].scenario):
            alone[k] = np.where(np.isnan(alone[k]), values[mild], alone[k])
    return alone


def compare_runs(policy: str, before: Floats, after: Floats, metric: str) -> Change | None:
    """Compare paired values (N,) of a metric, of `policy` after a change; None without a pair of known values."""
    both = ~np.isnan(before) & ~np.isnan(after)
    if not both.any():
        return None
    before, after = before[both], after[both]
    difference = after - before
    rates = rate_difference(before, after) if is_yes_no(metric) else None  # None, too, for means over conditions
    interval, p_value = rates or bootstrap_difference(difference)
    return Change(
        policy,
        len(difference),
        float(before.mean()),
        float(after.mean()),
        interval,
        int((difference < 0).sum()),
        int((difference > 0).sum()),
        p_value,
    )


def by_world(table: ResultTable, values: Floats, conditions: Sequence[int]) -> Floats:
    """Return the means (situations * S) of values (C, S) over the conditions of each situation."""
    scenarios = [table.conditions[k].scenario for k in conditions]
    rows = []
    for scenario in dict.fromkeys(scenarios):
        chosen = [k for k, name in zip(conditions, scenarios, strict=True) if name == scenario]
        rows.append(values[chosen].mean(axis=0))  # NaN where one is missing: means over other conditions differ
    return np.concatenate(rows)


def by_sample(table: ResultTable, values: Floats, conditions: Sequence[int]) -> Floats:
    """Return the means (N,) of values (C, S) over conditions, by sample of the table: a seed, or a drawn place."""
    return table.samples.average(values[list(conditions)].mean(axis=0))


def calm(table: ResultTable, scenario: str | None = None) -> list[int]:
    """Return the numbers of the mildest condition of every scenario, or of one."""
    chosen = [table.conditions.index(each) for each in mildest(table.conditions)]
    return [k for k in chosen if scenario in (None, table.conditions[k].scenario)]


MADE, DRAWN = "made to need messages", "as traffic has them"
"""Kinds of drives: calibrated situations, and all others."""


def kinds_of(table: ResultTable) -> list[tuple[str, list[int]]]:
    """Return the kinds of drives in a table, with their mildest conditions; empty where all are of one kind."""
    chosen: dict[str, list[int]] = {DRAWN: [], MADE: []}
    for k in calm(table):
        name = table.conditions[k].scenario.partition("(")[0]
        made = name in SITUATIONS and SITUATIONS.get(name).calibrated
        chosen[MADE if made else DRAWN].append(k)
    return list(chosen.items()) if all(chosen.values()) else []


def along(table: ResultTable, axis: Axis) -> list[tuple[str, list[int]]]:
    """Return the values of an axis in words, the mildest first, with the conditions of each; all else is mildest."""
    chosen = mildest_along(axis, table.conditions)
    texts = values_of(axis, [table.conditions[k] for k in chosen])
    by_harm = list(texts) if axis.named else sorted(texts, key=axis.harm)
    return [(texts[value], [k for k in chosen if axis.value(table.conditions[k]) == value]) for value in by_harm]


def changes_along(
    table: ResultTable, axis: Axis, policy: int, metric: str = CRASH, pairing: Pairing | None = None
) -> list[tuple[str, Change]]:
    """Return the changes of a policy at the values of an axis, in words, the mildest first; empty where one lacks."""
    tried = [(text, change(table, policy, conditions, metric, pairing)) for text, conditions in along(table, axis)]
    found = [(text, each) for text, each in tried if each is not None]
    return found if len(found) == len(tried) else []


def gone_at(axis: Axis, steps: Sequence[tuple[str, Change]]) -> str:
    """Say at which value of an axis fewer crashes are not shown any more, given the changes along it, mildest first.

    On an axis of names it is each of them; where the mildest value shows no gain, there is none to lose.
    """
    lost = [text for text, found in steps if not is_gain(found, CRASH)]
    last_shown = max((k for k, (text, _) in enumerate(steps) if text not in lost), default=-1)
    if steps[0][0] in lost and (axis.named or last_shown < 0):
        return f"{steps[0][0]}: no gain shown"
    if axis.named:
        return ", ".join(lost) or "none of these"
    return steps[last_shown + 1][0] if last_shown + 1 < len(steps) else "not in these"


def is_gain(found: Change, metric: str) -> bool:
    """Return whether a change is for the better, with its whole interval."""
    return found.change.high < 0 if less_is_better(metric) else found.change.low > 0


@dataclass(frozen=True, slots=True)
class RankCorrelation:
    """Spearman's rank correlation of a metric and the crash rate over policies, with its bootstrap interval.

    Attributes:
        metric: name of the metric, a mean over agents.
        value: the correlation: -1 where a better policy by the metric always crashes less.
        low: lower end of the interval.
        high: upper end of the interval.
        policies: number of policies.
    """

    metric: str
    value: float
    low: float
    high: float
    policies: int


def rank_correlation(table: ResultTable, metric: str, conditions: Sequence[int]) -> RankCorrelation | None:
    """Correlate a metric with the crash rate over policies; None for fewer than four, or where all crash alike.

    Upper bounds are left out. The interval is of a bootstrap over situations with seeds, 2000 resamples.
    """
    if metric not in table.metrics or CRASH not in table.metrics:
        return None
    chosen = [k for k, name in enumerate(table.policies) if name not in table.bounds]
    metric_values, crashes = (
        np.stack([by_world(table, table.values(name)[k], conditions) for k in chosen]) for name in (metric, CRASH)
    )
    whole = ~np.isnan(metric_values).any(axis=0) & ~np.isnan(crashes).any(axis=0)
    if len(chosen) < 4 or not whole.any():
        return None
    metric_values, crashes = metric_values[:, whole], crashes[:, whole]
    count = int(whole.sum())
    draws = stream(0, "bootstrap of a rank correlation").multinomial(count, np.full(count, 1 / count), _RESAMPLES)
    drawn = _spearman(draws @ metric_values.T, draws @ crashes.T)
    value = float(_spearman(metric_values.mean(axis=1)[None], crashes.mean(axis=1)[None])[0])
    if math.isnan(value):
        return None
    tail = 100 * (1 - CONFIDENCE) / 2
    low, high = np.nanpercentile(drawn, [tail, 100 - tail])
    return RankCorrelation(metric, value, float(low), float(high), len(chosen))


def _spearman(a: Floats, b: Floats) -> Floats:
    """Return rank correlations (B,) of rows (B, P); NaN where all of a row are equal."""
    from scipy.stats import rankdata  # here, because its import takes long

    first, second = (rankdata(rows, axis=1) for rows in (a, b))
    first, second = (each - each.mean(axis=1, keepdims=True) for each in (first, second))
    size = np.sqrt(np.square(first).sum(axis=1) * np.square(second).sum(axis=1))
    with np.errstate(invalid="ignore"):
        found: Floats = (first * second).sum(axis=1) / size
    return found
