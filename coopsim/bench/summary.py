"""A benchmark's results as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from coopsim.bench.cell import CellResult
from coopsim.files import write_whole


def write_summary(folder: Path, results: Sequence[CellResult]) -> tuple[Path, ...]:
    """Write `results.csv`."""
    lines = ["policy,latency_s,seed,MOTA"]
    lines += [f'"{r.cell.policy}",{r.cell.condition.latency_s},{r.cell.seed},{r.values.get("MOTA")}' for r in results]
    return (write_whole(folder / "results.csv", "\n".join(lines) + "\n"),)
