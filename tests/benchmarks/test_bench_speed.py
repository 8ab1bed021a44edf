"""How long a benchmark takes: the preset `quick`, two workers against one, and Ray against processes.

Run by `make bench`. Nothing here fails by time; the figures are printed, with how busy the machine was. Ratios are of
runs that take turns, so that what else the machine does weighs on both sides.
"""

from __future__ import annotations

import os
import resource
import statistics
import time
from pathlib import Path

import pytest

from coopsim.bench.benchmark import Engine, benchmark
from coopsim.bench.grid import Grid
from coopsim.bench.grid_file import find_grid

GRID = Grid(("no_fusion", "late_fusion", "sequential_kf"), latencies_ms=(0, 300), seeds=(0, 1), frames=60)


def seconds(grid: Grid, folder: Path, engine: Engine) -> float:
    began = time.perf_counter()
    benchmark(grid, folder, engine=engine)
    return time.perf_counter() - began


def load() -> str:
    return f"{os.getloadavg()[0]:.1f}"


def test_the_preset_quick(tmp_path: Path) -> None:
    grid = find_grid("quick").grid()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = seconds(grid, tmp_path, Engine(workers=2))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    on_cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"\nquick, {len(grid)} cells by two workers: {spent:.0f} s, {on_cpu:.0f} s of CPU; load {load()}")


def test_two_workers_against_one(tmp_path: Path) -> None:
    seconds(GRID, tmp_path / "warm", Engine(workers=1))
    turns = [(k, workers) for k in range(3) for workers in (1, 2)]
    spent = {turn: seconds(GRID, tmp_path / f"{turn}", Engine(workers=turn[1])) for turn in turns}
    ratios = [spent[k, 1] / spent[k, 2] for k in range(3)]
    print(f"\none worker / two workers: {statistics.median(ratios):.2f} of {ratios}; load {load()}")


def test_ray_against_processes(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    seconds(GRID, tmp_path / "warm", Engine(workers=2))
    turns = [(k, name) for k in range(3) for name in ("local", "ray")]
    spent = {turn: seconds(GRID, tmp_path / f"{turn}", Engine(turn[1], workers=2)) for turn in turns}
    extra = [spent[k, "ray"] - spent[k, "local"] for k in range(3)]
    print(f"\nRay, its start and end included, takes {statistics.median(extra):.1f} s more than processes ", end="")
    print(f"({extra}; by processes {spent[2, 'local']:.1f} s); load {load()}")
