"""Results of a benchmark that was never run: known effects, and noise that all policies of a seed share."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.support.rng import stream

FRAMES = 40
LATENCIES = tuple(Condition(latency_s=latency_s) for latency_s in (0.0, 0.1, 0.5))
EFFECTS: Mapping[str, float] = {"good": 60.0, "middling": 50.0, "bad": 30.0}


def result(cell: Cell, level: float, **values: Any) -> CellResult:
    """One result about `level` per cent, that falls by 20 with every second of latency."""
    named = {name: value for name, value in cell.condition.columns().items() if name != "attacks" or value}
    condition = f"Condition({', '.join(f'{name}={value!r}' for name, value in named.items())})"
    shared = stream(cell.seed, "traffic", condition).normal(scale=3.0)
    own = stream(cell.seed, "own", cell.policy, condition).normal(scale=0.5)
    value = level - 20 * cell.condition.latency_s + shared + own
    rewards = (
        np.full(cell.frames, value / 100) + stream(cell.seed, "frames", cell.policy).normal(size=cell.frames) * 0.02
    )
    made = {"sAMOTA": value, "HOTA": value / 2, "IDS": 100 - value, "bytes_per_s": 50 * level - 1500, "XYZ": 1.0}
    agents = {"cav_0": {"MOTA": value - 5}, "rsu_0": {"MOTA": value + level}}
    return CellResult(cell, made | values, agents, rewards, {"sent": 10, "lost": 1})


def results(
    effects: Mapping[str, float] = EFFECTS,
    conditions: Sequence[Condition] = LATENCIES,
    seeds: Sequence[int] = (0, 1, 2),
) -> list[CellResult]:
    """Every policy in every condition with every seed."""
    return [
        result(Cell(policy, condition, seed, FRAMES), effects[policy])
        for policy, condition, seed in itertools.product(effects, conditions, seeds)
    ]


def failed(
    cell: Cell, traceback: str = "Traceback (most recent call last):\nRuntimeError: it fell over\n"
) -> CellResult:
    """A cell without values."""
    return CellResult(cell, traceback=traceback)
