"""Results of a benchmark of situations that was never run: who crashes is known."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.bench.grid.cell import Cell, CellResult, Condition

RATES: Mapping[str, int] = {"no_fusion": 5, "late_fusion": 2, "coop_fuse": 3, "sequential_kf": 4, "truth": 0}
"""Of ten seeds, how many end in a crash."""

SENT: Mapping[str, float] = {**dict.fromkeys(RATES, 27e3), "no_fusion": 0.0, "truth": 0.0}


def crash_results(
    crashes: Callable[[str, Condition, int], bool] = lambda policy, condition, seed: seed < RATES[policy],
    conditions: Sequence[Condition] = (Condition("crossing"), Condition("merge")),
    seeds: Sequence[int] = tuple(range(10)),
    **values: Callable[[str], float],
) -> list[CellResult]:
    """Every policy in every condition with every seed; `values` gives further metrics by policy."""
    return [
        _result(Cell(policy, condition, seed, None), crashes(policy, condition, seed), values)
        for policy, condition, seed in itertools.product(RATES, conditions, seeds)
    ]


def _result(cell: Cell, crashed: bool, values: Mapping[str, Callable[[str], float]]) -> CellResult:
    made: dict[str, Any] = {"crash": 100.0 * crashed, "impact_speed": 8.0 if crashed else np.nan}
    made |= {"bytes_per_s": SENT[cell.policy], "phantom_brakes": float(cell.policy == "coop_fuse")}
    made |= {name: value(cell.policy) for name, value in values.items()}
    return CellResult(cell, made, rewards=np.zeros(5), bound=cell.policy == "truth")
