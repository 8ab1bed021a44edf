"""Benchmarks: policies, conditions and seeds go in; scores, statistics, reports and files for papers come out.

Start at `benchmark.py` for a grid of simulated runs, at `evaluate.py` for one run, at `leaderboard.py` for recordings,
and at `detect/` for average precision. The folders follow the data: `grid`, `engine`, `store`, `results`, `films`,
`report`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from coopsim.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from coopsim.bench.detect.detect import measure_detection as measure_detection
    from coopsim.bench.detect.detect_plan import DetectPlan as DetectPlan
    from coopsim.bench.engine.engine import Engine as Engine
    from coopsim.bench.evaluate import evaluate_recordings as evaluate_recordings
    from coopsim.bench.evaluate import rollout as rollout
    from coopsim.bench.grid.grid import Grid as Grid
    from coopsim.bench.grid.grid_file import find_grid as find_grid
    from coopsim.bench.report.publish import publish as publish
    from coopsim.bench.store.store import Store as Store

_HOMES = {
    "DetectPlan": "coopsim.bench.detect.detect_plan",
    "Engine": "coopsim.bench.engine.engine",
    "Grid": "coopsim.bench.grid.grid",
    "Store": "coopsim.bench.store.store",
    "evaluate_recordings": "coopsim.bench.evaluate",
    "find_grid": "coopsim.bench.grid.grid_file",
    "measure_detection": "coopsim.bench.detect.detect",
    "publish": "coopsim.bench.report.publish",
    "rollout": "coopsim.bench.evaluate",
}

__all__ = list(_HOMES)

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
