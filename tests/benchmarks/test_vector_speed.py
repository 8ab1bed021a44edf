"""How much faster two workers step many environments than the calling process, and how much memory 64 take.

The two take turns, as other work on the machine slows both. Printed are steps of one environment per second: the median
turn and the best, and how many times as many the workers make.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import psutil
import pytest

import coopsim
from coopsim.envs import DriveEnv
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
    "coopsim/drive-v1": {"vehicles": 20, "pedestrians": 0},
}

IDLE = {"tracks": pack_tracks(Tracks.empty())}


@pytest.mark.parametrize("row", ROWS)
def test_two_workers_against_the_calling_process(row: str) -> None:
    print(f"\n{row}, {COUNT} environments", flush=True)
    per_s: dict[int, list[float]] = {0: [], 2: []}
    cpu_ms: dict[int, list[float]] = {0: [], 2: []}
    with stepped(0, ROWS[row]) as alone, stepped(2, ROWS[row]) as shared:
        for _ in range(TURNS):
            for workers, turns in ((0, alone), (2, shared)):
                began, spent = time.perf_counter(), cpu_s()
                next(turns)
                per_s[workers].append(COUNT * STEPS / (time.perf_counter() - began))
                cpu_ms[workers].append(1e3 * (cpu_s() - spent) / (COUNT * STEPS))
            print(
                "  " + "   ".join(f"{workers} workers {each[-1]:6.0f}" for workers, each in per_s.items()), flush=True
            )
    gain = np.median(per_s[2]) / np.median(per_s[0])
    cpu = {workers: float(np.median(spent)) for workers, spent in cpu_ms.items()}
    print(f"  2 workers make {gain:.2f} times the steps; the best turns {max(per_s[2]) / max(per_s[0]):.2f} times")
    print(
        f"  CPU of a step: {cpu[0]:.2f} and {cpu[2]:.2f} ms, which on free cores gives {2 * cpu[0] / cpu[2]:.2f} times"
    )


@contextmanager
def stepped(workers: int, options: dict[str, Any]) -> Iterator[Iterator[None]]:
    """A vector that makes some steps at each turn; the first, which load and compile, are over."""
    made = coopsim.vector("crossing", COUNT, workers=workers, **BASE, **options) if "lidar" in options else None
    with made or coopsim.vector(_drive, COUNT, workers=workers, **options) as vector:
        vector.reset(seed=0)
        actions: Any = np.zeros(COUNT, np.int64)
        if made is None:
            actions = np.tile(np.float32([-0.5, 0.0]), (COUNT, 1))
        elif "agents" not in options:
            actions = [dict.fromkeys(agents, IDLE) for agents in vector.get_attr("agents")]

        def turns() -> Iterator[None]:
            while True:
                for _ in range(STEPS):
                    vector.step(actions)
                yield

        endless = turns()
        next(endless)
        yield endless


def _drive(**options: Any) -> DriveEnv:
    return DriveEnv(place="crossing", **options)


def cpu_s() -> float:
    """CPU time of this process and its workers so far."""
    me = psutil.Process()
    return sum(sum(process.cpu_times()[:2]) for process in (me, *me.children()))


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
