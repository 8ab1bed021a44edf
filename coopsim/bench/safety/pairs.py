"""Telling pairs: the same seed without and with messages, of which one ended in a crash and the other did not."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from coopsim.bench.benchmark import check
from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.labels import mildest
from coopsim.bench.report.clips import RunCell, pairs_in_time
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.bench.safety.recording import Recording, record
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES

CRASH, IMPACT = "crash", "impact_speed"

_REPEATED = 0.5
"""Weight of a pair that is disturbed, or whose situation, policy or outcome was chosen before, once for each."""


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two runs in the same world.

    Attributes:
        alone: the run without messages.
        sharing: the run with messages.
    """

    alone: CellResult
    sharing: CellResult

    @property
    def avoided(self) -> bool:
        """True if the run without messages crashed, and so the other did not; False the other way round."""
        return bool(self.alone.values.get(CRASH))


def policy_alone(table: ResultTable) -> int | None:
    """Return the number of the policy that sends nothing and is no upper bound; None without one.

    Of several it is `no_fusion`, or else the first.
    """
    if BYTES not in table.metrics:
        return None
    rates = known_mean(table.values(BYTES).reshape(len(table.policies), -1), axis=1)
    silent = [k for k, name in enumerate(table.policies) if rates[k] == 0 and name not in table.bounds]
    return min(silent, key=lambda k: (not table.policies[k].startswith("no_fusion"), k), default=None)


def telling_pairs(table: ResultTable, count: int) -> tuple[Pair, ...]:
    """Choose at most `count` pairs of which one run crashed, the fastest crash first, varied in all that differs.

    A situation with a seed is one event, and is there once, where nothing disturbs if it happens there.
    """
    alone = policy_alone(table)
    if alone is None or CRASH not in table.metrics:
        return ()
    crashed = table.values(CRASH)
    impact = np.nan_to_num(table.values(IMPACT)) if IMPACT in table.metrics else np.ones(crashed.shape)
    avoided, caused = crashed[alone] > crashed, crashed[alone] < crashed
    weights: Floats = np.where(avoided, 1.0 + impact[alone], 0.0) + np.where(caused, 1.0 + impact, 0.0)
    weights[[k for k, name in enumerate(table.policies) if name in table.bounds]] = 0.0
    calm = mildest(table.conditions)
    weights[:, [each not in calm for each in table.conditions]] *= _REPEATED
    runs = dict(zip(table.places, table.results, strict=True))
    scenarios = np.array([condition.scenario for condition in table.conditions])
    pairs: list[Pair] = []
    while len(pairs) < count and weights.max(initial=0.0) > 0:
        policy, condition, seed = (int(k) for k in np.unravel_index(weights.argmax(), weights.shape))
        pairs.append(Pair(runs[alone, condition, seed], runs[policy, condition, seed]))
        alike = avoided if avoided[policy, condition, seed] else caused
        same_place = scenarios == scenarios[condition]
        weights[:, same_place, seed] = 0.0
        for chosen in (np.s_[policy], np.s_[:, same_place], alike):
            weights[chosen] *= _REPEATED
    return tuple(pairs)


def find_pair(table: ResultTable, number: int) -> Pair:
    """Return the telling pair of a number from 1.

    Raises:
        InvalidValueError: there is none.
    """
    if policy_alone(table) is None:
        raise InvalidValueError(
            "results must have a policy that sends nothing, such as no_fusion, beside those that share, "
            f"got {', '.join(table.policies)} (--all-grids takes what other commands ran into the folder, too)"
        )
    found = telling_pairs(table, number)
    if not 1 <= number <= len(found):
        raise InvalidValueError(f"pair must be one of the {len(found)} of these results, from 1, got {number}")
    return found[number - 1]


def search_pair(grid: Grid, run: RunCell, seeds: Iterable[int]) -> Pair:
    """Run a grid's two policies, first the one without messages, seed by seed until the second avoids a crash.

    Raises:
        InvalidValueError: a run fails, no car is driven, or no crash is avoided with any seed.
    """
    check(grid)
    (condition,) = grid.conditions()
    alone, sharing = grid.policies
    for seed in seeds:
        both = []
        for policy in (alone, sharing):
            result = run(Cell(policy, condition, seed, None))
            if result.failed:
                raise InvalidValueError(f"{policy} failed in {condition.scenario} with seed {seed}: {result.reason}")
            if CRASH not in result.values:
                raise InvalidValueError(f"a car must be driven in {condition.scenario}: add control=planner")
            both.append(result)
        if both[0].values[CRASH] > both[1].values[CRASH]:
            return Pair(*both)
    raise InvalidValueError(
        f"{sharing} avoids no crash of {alone} in {condition.scenario} with any seed that was tried"
    )


def film_pairs(
    pairs: tuple[Pair, ...], run: RunCell, time_limit_s: float, clock: Callable[[], float] = time.monotonic
) -> tuple[list[tuple[Recording, Recording]], list[str]]:
    """Run the cells of pairs again and record them; none is begun after `time_limit_s`.

    Return the recordings, without and with messages, and a line for each pair that could not be recorded.
    """
    filmed, notes = list[tuple[Recording, Recording]](), list[str]()
    known: dict[Cell, Recording | str] = {}
    for pair in pairs_in_time(pairs, time_limit_s, clock, notes):
        for each in (pair.alone, pair.sharing):
            if each.cell not in known:
                known[each.cell] = record(each, run)
        alone, sharing = known[pair.alone.cell], known[pair.sharing.cell]
        if isinstance(alone, Recording) and isinstance(sharing, Recording):
            filmed.append((alone, sharing))
        else:
            notes += [each for each in (alone, sharing) if isinstance(each, str)]
    return filmed, notes
