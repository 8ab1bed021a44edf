"""How long a benchmark takes: a part of the preset `quick` by two workers, by Ray, and by one worker.

Run by `make bench`. Nothing here fails by time; the figures are printed, with how busy the
machine was.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.grid.grid_file import find_grid


def seconds(folder: Path, engine: Engine) -> float:
    began = time.perf_counter()
    benchmark(replace(find_grid("quick").grid(), seeds=(0,), latencies_ms=(0, 300), frames=20), folder, engine=engine)
    return time.perf_counter() - began


def test_quick_by_each_engine(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    print()
    for name, engine in {
        "two workers": Engine(workers=2),
        "Ray": Engine("ray", 2),
        "one worker": Engine(workers=1),
    }.items():
        busy = os.getloadavg()[0]
        print(
            f"{name:>12}: {seconds(tmp_path / name, engine):5.1f} s, start and end included; load {busy:.1f}",
            flush=True,
        )
