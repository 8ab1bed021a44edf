"""How much faster two workers step many environments than the calling process, and how much memory 64 take.

The two take turns, as other work on the machine slows both. Printed are steps of one environment per second: the median
turn and the best, and how many times as many the workers make.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import psutil
import pytest

import coopsim
from coopsim.envs.wrappers import BevImage, FixedSize, Flatten
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

COUNT, TURNS, STEPS = 16, 8, 5

MOST_MB = 2500

BASE = {"detector": "simulated", "max_cycles": 10**6, "seed": 0}
ONE: dict[str, Any] = {"agents": "single", "tracker": "late_fusion", "others": "late_fusion", "control": "policy"}
ROWS: dict[str, dict[str, Any]] = {
    "all agents, no rays": {"lidar": None},
    "all agents, 32 x 1024 rays": {"lidar": "HDL-32E"},
    "one agent drives, rows in one array": {"lidar": None, "wrap": [FixedSize, Flatten], **ONE},
    "one agent drives, pictures": {"lidar": None, "wrap": BevImage, **ONE},
}

IDLE = {"tracks": pack_tracks(Tracks.empty())}


@pytest.mark.parametrize("row", ROWS)
def test_two_workers_against_the_calling_process(row: str) -> None:
    print(f"\n{row}, {COUNT} environments", flush=True)
    turns = {workers: turn_of(workers, ROWS[row]) for workers in (0, 2)}
    per_s: dict[int, list[float]] = {workers: [] for workers in turns}
    for _ in range(TURNS):
        for workers, turn in turns.items():
            began = time.perf_counter()
            turn()
            per_s[workers].append(COUNT * STEPS / (time.perf_counter() - began))
        print("  " + "   ".join(f"{workers} workers {found[-1]:6.0f}" for workers, found in per_s.items()), flush=True)
    medians = {workers: float(np.median(found)) for workers, found in per_s.items()}
    gain, best = medians[2] / medians[0], max(per_s[2]) / max(per_s[0])
    print(f"  2 workers make {gain:.2f} times the steps (medians); the best turns {best:.2f} times", flush=True)


def turn_of(workers: int, options: dict[str, Any]) -> Callable[[], None]:
    """A function that steps a vector some times; the first steps, which load and compile, are over."""
    vector: Any = coopsim.vector("crossing", COUNT, workers=workers, **BASE, **options)
    vector.reset()
    if "agents" in options:
        actions = np.zeros(COUNT, np.int64)
    else:
        actions = [dict.fromkeys(agents, IDLE) for agents in vector.get_attr("agents")]

    def turn() -> None:
        for _ in range(STEPS):
            vector.step(actions)

    turn()
    return turn


def test_memory_of_64_environments() -> None:
    """Without rays: the proportional set sizes of all processes, after the first steps."""
    with coopsim.vector("crossing", 64, workers=2, lidar=None, **BASE) as vector:
        vector.reset()
        actions = [dict.fromkeys(agents, IDLE) for agents in vector.get_attr("agents")]
        for _ in range(10):
            vector.step(actions)
        me = psutil.Process()
        sizes = [process.memory_full_info().pss / 2**20 for process in (me, *me.children())]
    print(f"\n64 environments: {sum(sizes):.0f} MB in {len(sizes)} processes: {[round(size) for size in sizes]}")
    assert sum(sizes) < MOST_MB
