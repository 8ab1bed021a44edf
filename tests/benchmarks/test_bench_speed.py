"""How long a benchmark takes: the preset `quick` by two workers, by Ray, and by one worker.

Run by `make bench`, for some seven minutes. Nothing here fails by time; the figures are printed, with how busy the
machine was.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from coopsim.bench.benchmark import Engine, benchmark
from coopsim.bench.grid.grid_file import find_grid


def seconds(folder: Path, engine: Engine) -> float:
    began = time.perf_counter()
    benchmark(find_grid("quick").grid(), folder, engine=engine)
    return time.perf_counter() - began


def test_quick_by_each_engine(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    engines = {"two workers": Engine(workers=2), "Ray": Engine("ray", workers=2), "one worker": Engine(workers=1)}
    spent = {name: seconds(tmp_path / name, engine) for name, engine in engines.items()}
    two = spent["two workers"]
    print(f"\nquick by two workers: {two:.0f} s; by one: {spent['one worker'] / two:.2f} times as long; ", end="")
    print(f"by Ray, its start and end included: {spent['Ray'] / two:.2f} times; load {os.getloadavg()[0]:.1f}")
