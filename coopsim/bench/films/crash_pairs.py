"""Telling pairs: the same seed without and with messages, of which one ended in a crash and the other did not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from coopsim.bench.films.choice import Films, telling
from coopsim.bench.films.recording import Recording
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.grid.labels import mildest
from coopsim.bench.results.result_table import ResultTable, known_mean
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BYTES

CRASH, IMPACT = "crash", "impact_speed"

_DISTURBED = 0.5
"""Weight of a pair that is disturbed."""


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
    weights[:, [each not in calm for each in table.conditions]] *= _DISTURBED
    runs = dict(zip(table.places, table.results, strict=True))
    scenarios = np.array([condition.scenario for condition in table.conditions])

    def alike(place: tuple[int, ...]) -> tuple[Any, list[Any]]:
        policy, condition, seed = place
        here = scenarios == scenarios[condition]
        return np.s_[:, here, seed], [np.s_[policy], np.s_[:, here], avoided if avoided[place] else caused]

    places = islice(telling(weights, alike), count)
    return tuple(Pair(runs[alone, where, seed], runs[policy, where, seed]) for policy, where, seed in places)


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


def filmed_pairs(pairs: Sequence[Pair], films: Films) -> list[tuple[Recording, Recording]]:
    """Return the recordings of pairs whose films can be read, without and with messages."""
    known = ((pair, films.of(pair.alone, pair.sharing)) for pair in pairs)
    return [
        (Recording.of(pair.alone.cell, both[0]), Recording.of(pair.sharing.cell, both[1]))
        for pair, both in known
        if both is not None and all(film.drive for film in both)
    ]
