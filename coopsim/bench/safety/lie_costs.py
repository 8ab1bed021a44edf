"""Costs of lies for driven cars: crashes that a lie causes, brakes for nothing, and time lost, over paired runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from coopsim.bench.films.crash_pairs import CRASH
from coopsim.bench.grid.axis import ATTACKS
from coopsim.bench.grid.labels import varying_axes
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.safety.paired import Change, along, by_world, compare_runs
from coopsim.bench.text.forms import difference_text, form_of
from coopsim.metrics.built_in import BYTES

COSTS = {
    "phantom_brakes": "phantom brakes",
    "hard_brakes": "hard brakes",
    "progress": "progress (%)",
    "time_lost": "time lost (s)",
}
"""Metrics of what a lie costs besides crashes, with their headings."""


@dataclass(frozen=True, slots=True)
class LieCost:
    """Change that an attack makes to a policy, against the same runs while nobody lies.

    Attributes:
        attack: the attack, as the environments' option.
        policy: the policy.
        crash: change of crashes: `less` avoided and `more` caused by the lie.
        costs: changes of `COSTS` that the results have, by metric.
    """

    attack: str
    policy: str
    crash: Change
    costs: dict[str, Change]


def lie_costs(table: ResultTable) -> Iterator[LieCost]:
    """Yield the costs of every attack for every policy that listens, while nothing else disturbs.

    A pair is a situation with a seed.
    """
    for attack, honest, conditions in attacked(table) if CRASH in table.metrics else ():
        for policy in _listening(table):
            found = {name: _change(table, name, policy, honest, conditions) for name in (CRASH, *COSTS)}
            crash = found.pop(CRASH)
            if crash is not None:
                known = {name: each for name, each in found.items() if each is not None}
                yield LieCost(attack, table.policies[policy], crash, known)


def attacked(table: ResultTable) -> Iterator[tuple[str, list[int], list[int]]]:
    """Yield each attack with the numbers of the honest conditions, and of the same under it; all else is mildest.

    Attacks that come only together with another disturbance have no honest twin, and are left out.
    """
    axis = next((each for each in varying_axes(table.conditions) if each.option == ATTACKS and not each.along), None)
    for attack, conditions in along(table, axis)[1:] if axis is not None else ():
        twins = [table.conditions[k].changed(attacks="") for k in conditions]
        honest = [table.conditions.index(each) for each in twins if each in table.conditions]
        if len(honest) == len(conditions):
            yield attack, honest, conditions


def _listening(table: ResultTable) -> list[int]:
    """Return the numbers of the policies that send: one that says nothing is told nothing, and cannot be lied to."""
    if BYTES not in table.metrics:
        return list(range(len(table.policies)))
    rates = known_mean(table.values(BYTES).reshape(len(table.policies), -1), axis=1)
    return [k for k, rate in enumerate(rates.tolist()) if rate != 0]


def _change(table: ResultTable, metric: str, policy: int, honest: list[int], attacked: list[int]) -> Change | None:
    if metric not in table.metrics:
        return None
    values = table.values(metric)[policy]
    before, after = (by_world(table, values, conditions) for conditions in (honest, attacked))
    return compare_runs(table.policies[policy], before, after, metric)


CRASH_HEADS = ("attack", "policy", "pairs", "honest", "under the lie", "avoided", "caused", "difference")


def crash_rows(table: ResultTable) -> list[list[str]]:
    """Return rows of text below `CRASH_HEADS`."""
    rows = []
    for each in lie_costs(table):
        crash = each.crash
        rates = [f"{rate:.0f} %" for rate in (crash.alone, crash.sharing)]
        counts = [str(crash.less), str(crash.more)]
        rows.append([each.attack, each.policy, str(crash.pairs), *rates, *counts, difference_text(crash.change, ".1f")])
    return rows


def cost_heads(table: ResultTable) -> list[str]:
    """Return the headings of `cost_rows`."""
    return ["attack", "policy", *(title for name, title in COSTS.items() if name in table.metrics)]


def cost_rows(table: ResultTable) -> list[list[str]]:
    """Return rows of text: for each attack and policy the differences in the metrics of `COSTS`, lie minus honest."""
    names = [name for name in COSTS if name in table.metrics]
    return [
        [each.attack, each.policy, *(_difference(each.costs.get(name), name) for name in names)]
        for each in lie_costs(table)
        if names
    ]


def _difference(found: Change | None, metric: str) -> str:
    return "-" if found is None else difference_text(found.change, form_of(metric))
